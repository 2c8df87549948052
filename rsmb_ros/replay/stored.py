"""Results of frames that a recording holds already."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from rsmb_ros.bags.mcap_scan import Scan, Stored, WholeChunk, messages
from rsmb_ros.bags.recording import COMPRESSED, BagFrame
from rsmb_ros.bags.typestore import deserialised
from rsmb_ros.core.errors import BagError, ConfigError, RsmbError
from rsmb_ros.core.types import Region, Result
from rsmb_ros.messages.images import image_from_compressed, image_from_msg
from rsmb_ros.messages.outputs import IMAGE
from rsmb_ros.messages.stamps import NS_PER_S

from .detection import Compared
from .pairs import Pairs
from .recorded import PREFIX

LAST = PREFIX + 'diagnostics'  # written last of a frame


class CannotGoOn(RsmbError):
    """What an earlier replay has left is of no use; starting again would help."""


class LeftByAnother(CannotGoOn, ConfigError):
    """It was made otherwise, or by another program."""


class LeftDamaged(CannotGoOn, BagError):
    """It cannot be read, or contradicts the input."""


class StoredFrames:
    """
    Frames that an unfinished output holds.

    Parameters
    ----------
    path : Path
        Of the unfinished file.
    scan : Scan
        Of this file.

    """

    def __init__(self, path: Path, scan: Scan) -> None:
        self._path, self.scan = path, scan
        everything = scan.contents(len(scan.chunks))
        last = [channel.id for channel in everything.channels.values() if channel.topic == LAST]
        ends = [n for n, chunk in enumerate(scan.chunks) if last and last[0] in chunk.counts]
        self.chunks = ends[-1] + 1 if ends else 0  # what is behind belongs to no whole frame
        self._contents = scan.contents(self.chunks)
        self._whole: list[WholeChunk] = [scan.chunks[n] for n in ends]
        self._next = 0

    def __len__(self) -> int:
        return len(self._whole)

    @property
    def is_used_up(self) -> bool:
        """Whether all results were taken."""
        return self._next == len(self)

    def take(self, frame: BagFrame) -> Result | None:
        """
        Return the result of a frame; frames must come in their order.

        None for one that gave no result.

        Raises
        ------
        LeftDamaged
            If another frame is stored in its place, or the file is damaged.

        """
        found = self._outputs(self._next)
        summary = json.loads(found['regions_json'].data)
        if frame.index < summary['frame']:
            return None
        stamp = summary['stamp']
        stamp_ns = stamp['sec'] * NS_PER_S + stamp['nanosec']
        if (frame.index, frame.stamp_ns) != (summary['frame'], stamp_ns):
            raise self.contradicted(frame)
        self._next += 1
        return _result(summary, found)

    def contradicted(self, frame: BagFrame) -> LeftDamaged:
        """Return the error of a frame that is not the one stored in its place."""
        return LeftDamaged(
            f'{self._path}: was made from another input: the frame {frame.index} with stamp '
            f'{frame.stamp_ns} ns is not in its place; delete the file, or name that input'
        )

    def _outputs(self, n: int) -> dict[str, Any]:
        """Return the messages of one frame by the names of their outputs."""
        try:
            return _by_name(messages(self._path, self._whole[n], self._contents))
        except BagError as error:
            raise LeftDamaged(str(error)) from error


def spliced(
    stored: StoredFrames, pairs: Pairs, detect: Callable[[Pairs], Iterator[Compared]]
) -> Iterator[Compared]:
    """Iterate over the stored results of frames, then over those that `detect` finds."""
    for pair in pairs:
        if stored.is_used_up:
            yield from detect(chain([pair], pairs))
            return
        frame, reference = pair
        result = stored.take(frame)
        if result is None:
            for _ in detect(iter([pair])):  # counts it
                raise stored.contradicted(frame)
        else:
            yield Compared(frame, reference.image, result)


def _by_name(stored: Iterable[Stored]) -> dict[str, Any]:
    return {
        one.topic.removeprefix(PREFIX).removesuffix('/compressed'): deserialised(one.data, one.type)
        for one in stored
        if one.topic.startswith(PREFIX)
    }


def _result(summary: Mapping[str, Any], found: Mapping[str, Any]) -> Result:
    residual = found['residual']
    shape = residual.height, residual.width
    return Result(
        status=summary['status'],
        reason=summary['reason'],
        change_mask=_pixels(found['change_mask']),
        valid_mask=_pixels(found['valid_mask']),
        residual=np.frombuffer(residual.data, '<f4').reshape(shape),
        row_motion=found['row_motion'].data.reshape(shape[0], -1).astype(np.float64),
        row_uncertainty=found['row_uncertainty'].data.astype(np.float64),
        regions=tuple(map(_region, summary['regions'])),
        exposure_rows=_known(summary['exposure_rows']),
        gain=_known(summary['gain']),
        timings_ms={},
        views=_StoredViews(found['registered'], found['rectified']),
    )


def _region(stored: Mapping[str, Any]) -> Region:
    first = stored['first_seen']
    return Region(
        **stored['bounding_box'],
        area=stored['area_px'],
        kind=stored['kind'],
        score=stored['score'],
        relative_depth=stored['relative_depth'],
        id=stored['id'],
        first_seen=None if first is None else first['sec'] * NS_PER_S + first['nanosec'],
        reference_x=stored['reference_x'],
        reference_y=stored['reference_y'],
        shadow_like=stored['shadow_like'],
    )


class _StoredViews:
    """The two images of a stored frame, decoded when somebody looks at them; see `Views`."""

    def __init__(self, registered: Any, rectified: Any) -> None:
        self._registered, self._rectified = registered, rectified

    def registered(self) -> np.ndarray:
        """Return the stored image."""
        return _pixels(self._registered)

    def rectified(self) -> np.ndarray:
        """Return the stored image."""
        return _pixels(self._rectified)


def _pixels(message: Any) -> np.ndarray:
    if message.__msgtype__ == COMPRESSED:
        return image_from_compressed(message)
    assert message.__msgtype__ == IMAGE
    return image_from_msg(message)


def _known(value: float | None) -> float:
    return math.nan if value is None else value
