"""Every method on every case, in one process."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import ConfigError

from .case import Case
from .methods import Method, Outcome, Registrar
from .metrics import Score, score
from .ours import NAME, Ours
from .rivals import RIVALS, Attempt, Rival
from .suites import Suite
from .true_path import true_prediction

KNOWN_METHODS = (NAME, *RIVALS)
GAMMA = Config().camera.gamma  # of the true path's light where ours is not measured


@dataclass(frozen=True)
class CaseRun:
    """One case and what every method made of it."""

    case: Case
    outcomes: Mapping[str, Outcome]
    scores: Mapping[str, Score]


def methods_of(
    names: Iterable[str], config: Config, settings: Mapping[str, object] | None = None
) -> list[Method]:
    """
    Return the methods by name; `settings` are what a suite knows of its camera, for ours.

    Raises
    ------
    ConfigError
        If a name is not known.

    """
    methods: list[Method] = []
    for name in names:
        if name == NAME:
            methods.append(Ours(config, settings))
        elif name in RIVALS:
            methods.append(RIVALS[name])
        else:
            raise ConfigError(f'method {name!r} is not known: {", ".join(KNOWN_METHODS)}')
    return methods


def settings_of(suite: Suite, nuisances: str) -> Mapping[str, object]:
    """Return what is known of the camera: a suite's own, unless other nuisances are wanted."""
    return suite.settings if nuisances == 'usual' else {}


def run_case(case: Case, methods: Sequence[Method]) -> CaseRun:
    """Measure every method on one case; rivals with the same registrar register once."""
    gamma = next((method.gamma for method in methods if isinstance(method, Ours)), GAMMA)
    outcomes: dict[str, Outcome] = {}
    attempts: dict[Registrar, Attempt] = {}
    for method in methods:
        if isinstance(method, Rival):
            if method.registrar not in attempts:
                attempts[method.registrar] = method.register(
                    case.reference, case.live, case.focal_px
                )
            outcomes[method.name] = method.judge(case.live, attempts[method.registrar])
        else:
            outcomes[method.name] = method(case.reference, case.live, case.focal_px)
    truth = true_prediction(case, gamma)
    scores = {name: score(outcome, case, name, truth) for name, outcome in outcomes.items()}
    return CaseRun(case, outcomes, scores)
