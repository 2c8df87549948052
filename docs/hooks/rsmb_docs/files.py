"""Files that are written: their fields are read from what the code really writes."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from rsmb_ros.bags.writing import METADATA
from rsmb_ros.cli import detect
from rsmb_ros.core import REGISTERED, Config, Region, Result
from rsmb_ros.messages.outputs import OUTPUTS
from rsmb_ros.replay.csv_sink import CSV_COLUMNS

from .sources import field_comments, readable
from .tables import code, described, table

STEPS = {'coarse': 7.2, 'registration': 33.1}
SIZE = (2, 3)
STAMP_NS = 1_700_000_002_000_000_000
# Beside the fields of `Result` and `Region`, whose comments are used.
OF_JSON = {
    'status': '`registered` or `not_registered`',
    'reason': 'empty when registered, else why not, for people',
    'regions': 'see below; changes first, then static objects',
    'timings_ms': 'ms of each step that ran, by its name',
    'row_motion': 'one entry a row, top to bottom; null where not registered',
    'config': 'every parameter by group, as in [Parameters](parameters.md)',
    'version': 'of rsmb_ros',
}
OF_REGION = {
    'first_seen': 'stamp of the first frame that showed it, `{sec, nanosec}`; null: unknown',
    'bounding_box.x': 'left column [px]',
    'bounding_box.y': 'top row [px]',
    'bounding_box.width': '[px]',
    'bounding_box.height': '[px]',
    'area_px': '[px]',
}
OF_CSV = {
    'frame': 'number of the frame in the bag, from 0',
    'stamp_ns': 'stamp of the frame [ns]',
    'status': 'as in result.json',
}


def example() -> dict[str, Any]:
    """Return a result.json of two rows: made by the code that writes the real ones."""
    blank = np.zeros(SIZE, np.uint8)
    result = Result(
        status=REGISTERED,
        reason='',
        change_mask=blank,
        valid_mask=blank,
        residual=blank.astype(np.float32),
        row_motion=np.tile([3.21, -1.5, 0.02, 1.001, 0.0, 0.01], (SIZE[0], 1)),
        row_uncertainty=np.full(SIZE[0], 0.04),
        regions=(
            Region(520, 218, 22, 40, 712, 'change', 0.96, None, 3, STAMP_NS, 512.4, 240.1),
            Region(318, 4, 121, 109, 10211, 'static', 1.0, relative_depth=0.9),
        ),
        exposure_rows=50.2,
        gain=1.1,
        timings_ms=STEPS,
        views=None,  # type: ignore
    )
    return json.loads(detect._json(result, Config()))


def summary_fields() -> str:
    """Return the fields of result.json."""
    known = field_comments(Result)
    texts = {name: OF_JSON.get(name, known.get(name, '')) for name in example()}
    _check(OF_JSON, texts)
    rows = [
        (code(name), _type(value), _text(name, texts, 'null')) for name, value in example().items()
    ]
    return table(('field', 'type', 'meaning'), rows)


def region_fields() -> str:
    """Return the fields of a region."""
    regions = [_flat(region) for region in example()['regions']]
    both = {name: [region[name] for region in regions] for name in regions[0]}
    known = field_comments(Region)
    texts = {name: OF_REGION.get(name, known.get(name, '')) for name in both}
    _check(OF_REGION, texts)
    rows = [
        (code(name), _type(*values), _text(name, texts, 'null')) for name, values in both.items()
    ]
    return table(('field', 'type', 'meaning'), rows)


def row_fields() -> str:
    """Return the names of a row's numbers."""
    return ', '.join(code(name) for name in example()['row_motion'][0])


def example_json() -> str:
    """Return a short example, with what is long left out."""
    shown = example()
    shown['config'] = {'camera': shown['config']['camera'], '...': '...'}
    for region in shown['regions']:
        region['score'] = round(region['score'], 2)
    text = json.dumps(shown, indent=1)
    return f'```json\n{text}\n```\n'


def csv_columns() -> str:
    """Return the columns of `rsmb replay --csv`."""
    known = field_comments(Region)
    texts = {name: OF_CSV.get(name, known.get(name, '')) for name in CSV_COLUMNS}
    rows = [(code(name), _text(name, texts, 'empty')) for name in texts]
    return table(('column', 'meaning'), rows)


def pictures_of_detect() -> str:
    """Return the images that `rsmb detect` writes."""
    blank = np.zeros((*SIZE, 3), np.uint8)
    result = Result(
        REGISTERED, '', blank[..., 0], blank[..., 0], blank[..., 0].astype(np.float32),
        np.zeros((SIZE[0], 6)), np.zeros(SIZE[0]), (), 0.0, 1.0, {}, _Views(blank),  # type: ignore
    )  # fmt: skip
    names = detect._pictures(result, blank)
    return ', '.join(code(f'{name}.png') for name in names)


def bag_topics() -> str:
    """Return the topics of a replay's bag and the name of its metadata record."""
    topics = ', '.join(code(f'/rsmb/{output.name}') for output in OUTPUTS)
    return f'{topics}. The metadata record `{METADATA}` holds version and configuration.'


class _Views:
    """Two images that cost nothing."""

    def __init__(self, image: np.ndarray) -> None:
        self._image = image

    def registered(self) -> np.ndarray:
        return self._image

    def rectified(self) -> np.ndarray:
        return self._image


def _flat(region: dict[str, Any]) -> dict[str, Any]:
    box = {f'bounding_box.{name}': value for name, value in region['bounding_box'].items()}
    return box | {name: value for name, value in region.items() if name != 'bounding_box'}


def _check(own: dict[str, str], texts: dict[str, str]) -> None:
    """Refuse a text of ours for what is not written any more."""
    described(own, {name: text for name, text in own.items() if name in texts}, __file__)


def _text(name: str, texts: dict[str, str], nothing: str) -> str:
    """Return the text of a field, with what stands in this kind of file for Python's None."""
    if not texts[name]:
        raise KeyError(f'field {name} has no comment in core/types.py and no text in {__file__}')
    return readable(texts[name], nothing)


def _type(*values: object) -> str:
    names = {
        'NoneType': 'null',
        'str': 'string',
        'bool': 'bool',
        'int': 'integer',
        'float': 'number',
        'list': 'list',
        'dict': 'object',
    }
    kinds = {names[type(value).__name__]: None for value in values}
    return ' or '.join(sorted(kinds, key='null'.__eq__))
