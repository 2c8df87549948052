"""A named, seeded series of cases."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rsmb_ros.core.errors import FileProblem
from rsmb_ros.evaluation.case import Case

from .nuisances import ALL, NONE, described
from .recipe import Recipe, simulated
from .scouts import drawn_scout

NUISANCES = ('usual', 'none', 'all')  # what a suite says, or none or all of them


@dataclass(frozen=True)
class Wish:
    """What of a suite is wanted."""

    shape: tuple[int, int] | None = None  # rows, cols [px]; None: the suite's own; not for video
    nuisances: str = 'usual'  # one of NUISANCES
    data: Path | None = None  # folder with real photos and videos
    first: int | None = None  # so many cases only; None: all


@dataclass(frozen=True)
class Suite:
    """Cases that are made one by one; equal wishes give equal bytes."""

    name: str
    about: str  # one line for tables
    cases: Callable[[Wish], Iterator[Case]]
    size: int
    frequencies: tuple[str, ...] = ()  # how often which nuisance occurs
    settings: Mapping[str, object] = field(default_factory=dict)  # known of the camera, for ours
    needs: tuple[str, ...] = ()  # files below the data folder

    def check(self, wish: Wish) -> None:
        """Say early what is missing; raises as `data_of`."""
        if self.needs:
            data_of(wish, self.name, self.needs)


def data_of(wish: Wish, suite: str, needs: Sequence[str]) -> Path:
    """
    Return the folder with real pictures.

    Raises
    ------
    FileProblem
        If it is not given, or what `needs` names is not in it.

    """
    wants = f'suite {suite} needs {", ".join(needs)}'
    if wish.data is None:
        raise FileProblem(f'{wants}: give the folder that holds them with --data or RSMB_DATA')
    missing = [pattern for pattern in needs if not any(wish.data.glob(pattern))]
    if missing:
        raise FileProblem(f'{wish.data}: {wants}, missing there: {", ".join(missing)}')
    return wish.data


def drawn_suite(
    name: str,
    about: str,
    count: int,
    recipes: Sequence[Recipe],
    shape: tuple[int, int] = (480, 640),
    groups: Sequence[str] = (),
    settings: Mapping[str, object] | None = None,
) -> Suite:
    """Return a suite of procedural scenes; the recipes take turns, `groups` are their names."""

    def cases(wish: Wish) -> Iterator[Case]:
        wanted = wish.shape or shape
        for n in range(min(count, wish.first or count)):
            recipe = wished(recipes[n % len(recipes)], wish)
            group = f'/{groups[n % len(recipes)]}' if groups else ''
            yield simulated(
                f'{name}{group}/{n:02d}',
                recipe,
                wanted,
                n // len(recipes) if len(recipes) > 1 else n,
                seeded(name, n),
                drawn_scout(wanted),
            )

    said = tuple(dict.fromkeys(described(recipe.nuisances) for recipe in recipes))
    return Suite(name, about, cases, count, said, settings or {})


def wished(recipe: Recipe, wish: Wish) -> Recipe:
    """Return the recipe with the nuisances that are wanted."""
    if wish.nuisances == 'usual':
        return recipe
    return replace(recipe, nuisances=ALL if wish.nuisances == 'all' else NONE)


def seeded(suite: str, number: int) -> np.random.Generator:
    """Return the generator of one case: each can be made without the others."""
    return np.random.default_rng([zlib.crc32(suite.encode()), number])
