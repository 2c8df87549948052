"""Every method on every case, in one process."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import ConfigError

from .case import Case
from .methods import Method, Outcome, Registrar
from .metrics import Score, score
from .ours import NAME, Ours
from .rivals import RIVALS, Attempt, Rival
from .suites import Suite

KNOWN_METHODS = (NAME, *RIVALS)


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


def run_case(case: Case, methods: Iterable[Method]) -> CaseRun:
    """Measure every method on one case; rivals with the same registrar register once."""
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
    scores = {name: score(outcome, case, name) for name, outcome in outcomes.items()}
    return CaseRun(case, outcomes, scores)
