"""
Fits the score of a region to candidates whose truth is known, and says how good it is.

    python -m rsmb_ros.evaluation.score_fit --data DIR

Cases are those of suites, and others with seeds of their own; each with a change is also faded.
Each half of them is held out once, the photos always, where there are any. Half an hour.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
from scipy.special import expit
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from rsmb_ros.core.config import Config
from rsmb_ros.core.regions import WEIGHTS

from .case import Case
from .score_samples import Sample, faded, samples_of
from .suites import SUITES, Wish
from .suites.nuisances import STRONG_LIGHT
from .suites.recipe import Recipe, simulated
from .suites.scouts import drawn_scout
from .suites.simulated import HOUSES, LAYERED, PLANAR, REGIMES, UNCHANGED, quiet
from .suites.suite import seeded

SHAPE = (480, 640)
SUITES_USED = ('planar', 'layered', 'regimes', 'far', 'light', 'weak-texture', 'nochange')
FIRST = 16  # cases of each
OTHERS = 182  # cases of `RECIPES`, each taking its turn so often
RECIPES = (
    *UNCHANGED,
    PLANAR,
    LAYERED,
    Recipe(style=HOUSES, regimes=REGIMES),
    Recipe(style=HOUSES, nuisances=STRONG_LIGHT, moving_shadows=1),
    Recipe(style=HOUSES, offset=(0.1, 0.2), rotation_deg=(0.0, 5.0), zoom=(0.0, 0.05)),
    quiet(Recipe(style=HOUSES, offset=(0.1, 0.2), rotation_deg=(0.0, 5.0), zoom=(0.0, 0.05))),
    Recipe(texture=(0.04, 0.25)),
)
BINS = (0.0, 0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
FREEDOM = 10.0  # inverse strength of the logistic regression's ridge, at standardised traits


@dataclass(frozen=True)
class Reliability:
    """Candidates of one range of scores."""

    low: float
    high: float
    count: int
    wrong: int
    score: float  # mean, kinds weighed alike
    right: float  # share of right ones, kinds weighed alike


def suite_cases() -> Iterator[tuple[int, Case]]:
    """Yield the first cases of suites with their half, 0 or 1, and faded those with a change."""
    for name in SUITES_USED:
        for n, case in enumerate(SUITES[name].cases(Wish(first=FIRST))):
            yield n % 2, case
            if case.changed:
                yield n % 2, faded(case, np.random.default_rng(n))


def other_cases(count: int) -> Iterator[tuple[int, Case]]:
    """Yield cases of no suite, likewise."""
    for n in range(count):
        recipe, turn = RECIPES[n % len(RECIPES)], n // len(RECIPES)
        rng = seeded('score', n)
        case = simulated(f'score/{n}', recipe, SHAPE, turn, rng, drawn_scout(SHAPE))
        yield turn % 2, case
        if case.changed:
            yield turn % 2, faded(case, rng)


def photo_cases(data: Path) -> Iterator[Case]:
    """Yield the photos and, faded, those that have changed."""
    for n, case in enumerate(SUITES['photos'].cases(Wish(data=data))):
        yield case
        if case.changed and case.motion is not None and case.motion.clean is not None:
            yield faded(case, np.random.default_rng(n))


def fitted(samples: Sequence[Sample]) -> np.ndarray:
    """
    Fit a logistic regression to samples, right and wrong ones counting equally much.

    Returns
    -------
    ndarray of shape (1 + traits,)
        Offset, then the weight of each of `core.regions.traits_of`.

    """
    traits, right = _arrays(samples)
    mean, spread = traits.mean(axis=0), traits.std(axis=0) + 1e-9
    model = LogisticRegression(C=FREEDOM, class_weight='balanced', max_iter=1000)
    model.fit((traits - mean) / spread, right)
    weights = model.coef_[0] / spread
    return np.array([float(model.intercept_[0]) - float(weights @ mean), *weights])


def scores(samples: Sequence[Sample], weights: np.ndarray) -> np.ndarray:
    """Return the score of each sample (n,), 0..1."""
    traits, _ = _arrays(samples)
    return expit(weights[0] + traits @ weights[1:])


def auc(samples: Sequence[Sample], weights: np.ndarray) -> float:
    """Return the area under the ROC curve: how often a right one scores above a wrong one."""
    return float(roc_auc_score(_arrays(samples)[1], scores(samples, weights)))


def reliability(samples: Sequence[Sample], weights: np.ndarray) -> list[Reliability]:
    """Compare scores with what is right, as if right and wrong ones were equally frequent."""
    found, (_, right) = scores(samples, weights), _arrays(samples)
    share = np.where(right, 0.5 / max(1, right.sum()), 0.5 / max(1, (~right).sum()))
    table = []
    for n, (low, high) in enumerate(pairwise(BINS)):
        inside = (found >= low) & ((found < high) | (n == len(BINS) - 2))
        if inside.any():
            part = share[inside]
            table.append(
                Reliability(
                    low,
                    high,
                    int(inside.sum()),
                    int((~right[inside]).sum()),
                    float(part @ found[inside] / part.sum()),
                    float(part @ right[inside] / part.sum()),
                )
            )
    return table


def report(name: str, samples: Sequence[Sample], weights: np.ndarray) -> str:
    """Return AUC and reliability as text."""
    wrong = sum(not sample.right for sample in samples)
    lines = [f'{name}: {len(samples)} candidates, {wrong} wrong']
    if 0 < wrong < len(samples):
        lines[0] += f', AUC {auc(samples, weights):.3f}'
    lines += [
        f'  {row.low:.1f}-{row.high:.1f}: {row.count} candidates, {row.wrong} wrong; '
        f'score {row.score:.2f}, right {row.right:.2f}'
        for row in reliability(samples, weights)
    ]
    return '\n'.join(lines)


def _arrays(samples: Sequence[Sample]) -> tuple[np.ndarray, np.ndarray]:
    return np.stack([one.traits for one in samples]), np.array([one.right for one in samples])


def main() -> None:
    """Draw, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--data', type=Path, help='real pictures, held out')
    args = parser.parse_args()
    halves: tuple[list[Sample], list[Sample]] = ([], [])
    for half, case in chain(suite_cases(), other_cases(OTHERS)):
        halves[half].extend(samples_of(case, Config()))
    photos = photo_cases(args.data) if args.data else iter(())
    real = [one for case in photos for one in samples_of(case, Config())]
    print(compared(halves, real))


def compared(halves: tuple[Sequence[Sample], Sequence[Sample]], real: Sequence[Sample]) -> str:
    """Say what each half, and both, would have for weights, and how good those in use are."""
    in_use = np.array(WEIGHTS)
    lines = []
    for own, other in (halves, halves[::-1]):
        lines += [report('held out', other, fitted(own)), report('in use', other, in_use)]
    both = fitted([*halves[0], *halves[1]])
    lines += [f'offset, weights: {", ".join(f"{weight:.2f}" for weight in both)}']
    if real:
        lines += [report('photos', real, both), report('photos, in use', real, in_use)]
    return '\n'.join(lines)


if __name__ == '__main__':
    main()
