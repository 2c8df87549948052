"""Static objects of all cases in one table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from rsmb_ros.report.html import Table

from .metrics import Score, ratio
from .statics import StaticObject
from .summary import median, percentile
from .tables import ABSENT

RIGHT = 0.02  # of relative depth
MOST_BLUR = 20.0  # px, up to which a static object must not be called a change
TEXTURED = 5.0  # grey levels per px, mean gradient
PARALLAX = (1.0, 3.0)  # px between little, some and much
HEAD = (
    'suite',
    'objects',
    'in view',
    'depth found %',
    'depth error median / p90',
    f'within {RIGHT} %',
    'called changes',
)
STATIC_NOTES = (
    'Static objects: layers that show at least 0.026 % of the frame; their depth is that of the '
    'static region whose box matches theirs at IoU >= 0.25. An object that hardly moves against '
    f'the ground has no depth to find. Called changes: of those in frames of at most {MOST_BLUR:g} '
    'px of blur, those that a reported region lies on which touches no change. Texture: mean '
    'gradient [grey levels per px]. Parallax: motion against the ground.'
)


def static_table(scores: Iterable[Score], method: str) -> Table | None:
    """
    Say of each suite how the static objects fared, all of them and by texture and parallax.

    Parameters
    ----------
    scores : iterable of Score
        Those of other methods are left out.
    method : str
        Whose.

    Returns
    -------
    Table or None
        None where no case has static objects.

    """
    by_suite: dict[str, list[StaticObject]] = {}
    for score in scores:
        if score.method == method and score.statics:
            by_suite.setdefault(score.suite, []).extend(score.statics)
    rows = [row for suite, found in by_suite.items() for row in _rows(suite, found)]
    return Table(f'static objects, {method}', list(HEAD), rows) if rows else None


def _rows(suite: str, objects: Sequence[StaticObject]) -> list[list[str]]:
    little, much = PARALLAX
    kinds = {
        'all': objects,
        f'texture < {TEXTURED:g}': [one for one in objects if one.texture < TEXTURED],
        f'texture >= {TEXTURED:g}': [one for one in objects if one.texture >= TEXTURED],
        f'parallax < {little:g} px': [one for one in objects if one.parallax_px < little],
        f'parallax {little:g} to {much:g} px': [
            one for one in objects if little <= one.parallax_px < much
        ],
        f'parallax >= {much:g} px': [one for one in objects if one.parallax_px >= much],
    }
    return [[suite, kind, *_cells(found)] for kind, found in kinds.items() if found]


def _cells(objects: Sequence[StaticObject]) -> list[str]:
    errors = [one.error for one in objects if not math.isnan(one.error)]
    counted = [one for one in objects if not one.blur_px > MOST_BLUR]
    return [
        str(len(objects)),
        _percent(ratio(len(errors), len(objects))),
        f'{median(errors):.3f} / {percentile(errors, 90):.3f}' if errors else ABSENT,
        _percent(ratio(sum(error <= RIGHT for error in errors), len(errors))),
        f'{sum(one.as_change for one in counted)} of {len(counted)}',
    ]


def _percent(share: float) -> str:
    return ABSENT if math.isnan(share) else f'{100 * share:.0f}'
