"""The topics that a replay writes, and how each is made; nothing in them depends on the clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np

from rsmb_ros.bags.factory import BagFactory
from rsmb_ros.bags.recording import COMPRESSED, BagFrame
from rsmb_ros.core.errors import FrameError
from rsmb_ros.core.types import Result
from rsmb_ros.messages.as_json import summary_to_dict, to_json
from rsmb_ros.messages.detections import DETECTIONS, detection_fields
from rsmb_ros.messages.diagnostics import DIAGNOSTICS, frame_status
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT, Output

PREFIX = '/rsmb/'
PNG, JPEG = 'png', 'jpeg'
MASKS = ('change_mask', 'valid_mask')
PHOTOS = ('registered', 'rectified', 'overlay')
_JPEG_QUALITY = 90

_FACTORY = BagFactory()
Builder = Callable[[BagFrame, Result], Any]


class Recorded(NamedTuple):
    """One topic of the output."""

    name: str  # without prefix and transport: 'change_mask'
    topic: str
    type: str
    build: Builder


def recorded(compress: str | None = None) -> tuple[Recorded, ...]:
    """
    Return what is written for every frame, in this order.

    Parameters
    ----------
    compress : 'png' or 'jpeg', optional
        How photos are compressed; masks are then PNG, which loses nothing. Residuals are never
        compressed: both formats would lose of them. None: all images are raw.

    """
    shared = tuple(_as_recorded(output, compress) for output in OUTPUTS)
    return (
        *shared,
        Recorded('row_uncertainty', PREFIX + 'row_uncertainty', ROWS, _row_uncertainty),
        Recorded('regions', PREFIX + 'regions', DETECTIONS, _regions),
        # the last one: a frame is whole when it is there
        Recorded('diagnostics', PREFIX + 'diagnostics', DIAGNOSTICS, _diagnostics),
    )


def summary_of(frame: BagFrame, result: Result) -> dict[str, Any]:
    """Return all numbers of a frame but those of its rows; no timings, which differ every time."""
    header = frame.header
    summary = {'frame': frame.index, **summary_to_dict(result, header.stamp, header.frame_id)}
    del summary['timings_ms']
    return summary


def _as_recorded(output: Output, compress: str | None) -> Recorded:
    topic = PREFIX + output.name
    if output.name == 'regions_json':
        return Recorded(output.name, topic, TEXT, _regions_json)
    if compress and output.name in MASKS:
        return _compressed(output, topic, PNG)
    if compress and output.name in PHOTOS:
        return _compressed(output, topic, compress)

    def build(frame: BagFrame, result: Result) -> Any:
        return output.build(result, frame.image, _FACTORY, frame.header)

    return Recorded(output.name, topic, output.type, build)


def _compressed(output: Output, topic: str, form: str) -> Recorded:
    """Return an image output as CompressedImage, named as image_transport names it."""
    assert output.type == IMAGE

    def build(frame: BagFrame, result: Result) -> Any:
        array = output.build(result, frame.image, _Arrays(), frame.header)
        options = [] if form == PNG else [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        done, data = cv2.imencode('.png' if form == PNG else '.jpg', array, options)
        if not done:
            raise FrameError(f'{output.name} of {array.shape} px cannot be stored as {form}')
        encoding = 'mono8' if array.ndim == 2 else 'bgr8'
        text = f'{encoding}; {form} compressed {encoding if array.ndim == 3 else ""}'.rstrip()
        return _FACTORY.compressed(frame.header, data.tobytes(), text)

    return Recorded(output.name, topic + '/compressed', COMPRESSED, build)


class _Arrays(BagFactory):
    """Leaves an image as it is."""

    def image(self, header: Any, array: np.ndarray) -> Any:
        """Return the array."""
        return array


def _regions_json(frame: BagFrame, result: Result) -> Any:
    return _FACTORY.text(to_json(summary_of(frame, result)))


def _row_uncertainty(frame: BagFrame, result: Result) -> Any:
    return _FACTORY.rows(result.row_uncertainty, ('row',))


def _regions(frame: BagFrame, result: Result) -> Any:
    return _FACTORY.detections(frame.header, detection_fields(result))


def _diagnostics(frame: BagFrame, result: Result) -> Any:
    return _FACTORY.diagnostics(frame.header, frame_status(frame.index, result))
