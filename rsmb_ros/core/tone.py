"""
The tone curve of a camera, from how its edges blur.

Light adds up in a blur, display values do not: an edge that moves during the exposure becomes a
ramp in linear light, and how that ramp is bent in display values tells the curve. Only what is
blurred says anything; of a frame that hardly is, no curve is believed.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median

import cv2
import numpy as np

from .config import CameraConfig, Config
from .frame import PathFrame
from .photometric import to_linear
from .sampling import half_pixel, softened
from .seen_light import SeenLight
from .types import Result

USUAL = CameraConfig().gamma  # where nothing can be said, and where the search starts
ASKED = (1.0, 1.5, 2.0, 2.5, 3.0)
SHARPENED = 0.12  # share of an unsharp mask that cameras add: most none, some .2 to .8
MASK_SIGMA = 1.0  # px, of that mask
ROUNDS = 3  # of undoing it: what is left is below a thousandth
STEP = 0.1  # of what is believed: finer changes nothing, and a reference prepared serves longer
OUTLIER = 8.0  # grey levels; residuals beyond count as that
CLEAR = 1.1  # of the least mean square, that the worst of `ASKED` must have
HELD_AFTER = 5  # frames of a stream that said something


def estimated_gamma(frame: PathFrame, change: np.ndarray, image: np.ndarray) -> float | None:
    """
    Find the exponent of the tone curve that explains a registered frame best.

    The path stays as it is: what other curves would do to it is little. What the camera has
    sharpened is undone, as far as cameras usually do; how far this one did is not to be told apart.

    Parameters
    ----------
    frame : PathFrame
        Registered, by whatever curve.
    change : ndarray of shape (M, N), bool
        What is new in it.
    image : ndarray of shape (M', N') or (M', N', 3), uint8
        The reference.

    Returns
    -------
    float or None
        1 to 3; None where the frame does not tell.

    """
    where = frame.judged & ~change
    if not where.any():
        return None
    costs = _costs(_Unsharpened(frame, image), where)
    if costs.max() < CLEAR * costs.min():
        return None
    return STEP * round(_lowest(costs) / STEP)


def _costs(frame: _Unsharpened, where: np.ndarray) -> np.ndarray:
    """Mean square of what each curve of `ASKED` leaves unexplained `where` (M, N) bool."""
    return np.array(
        [
            np.mean(np.minimum(np.abs(frame.residual(gamma, where)[where]), OUTLIER) ** 2)
            for gamma in ASKED
        ]
    )


def _lowest(costs: np.ndarray) -> float:
    """Return where a parabola through the least of `costs` and its neighbours is lowest."""
    middle = min(max(int(costs.argmin()), 1), len(ASKED) - 2)
    before, at, after = costs[middle - 1 : middle + 2]
    bend = before - 2 * at + after
    if bend <= 0:  # no minimum between them: the curve lies at an end
        return ASKED[int(costs.argmin())]
    off = 0.5 * (ASKED[1] - ASKED[0]) * (before - after) / bend
    return float(min(max(ASKED[middle] + off, ASKED[0]), ASKED[-1]))


class _Unsharpened:
    """
    A registered frame and its reference before the camera has sharpened their display values.

    Sharpening bends edges as a smaller exponent does: taken for none, it costs .07 of the exponent
    per tenth.
    """

    def __init__(self, frame: PathFrame, image: np.ndarray) -> None:
        self._frame = frame
        planes = [image] if image.ndim == 2 else np.moveaxis(image, 2, 0)
        self._planes = [_unsharpened(plane.astype(np.float32)) for plane in planes]
        self._live = _unsharpened(frame.grey)

    def residual(self, gamma: float, where: np.ndarray) -> np.ndarray:
        """What a curve leaves unexplained of the frame (M, N) [grey levels]."""
        lights = [to_linear(plane, gamma) for plane in self._planes]
        sharp = [self._frame.light_seen(half_pixel(light)) for light in lights]
        soft = [self._frame.light_seen(half_pixel(softened(light, 1.0))) for light in lights]
        seen = SeenLight(np.stack(sharp), np.stack(soft), gamma)
        return _sharpened(self._live - seen.shown(seen.fitted(self._live, where)))


def _sharpened(image: np.ndarray) -> np.ndarray:
    """Add an unsharp mask to display values (M, N)."""
    return image + SHARPENED * (image - cv2.GaussianBlur(image, (0, 0), MASK_SIGMA))


def _unsharpened(image: np.ndarray) -> np.ndarray:
    """Take it away again."""
    found = image
    for _ in range(ROUNDS):
        found = found + image - _sharpened(found)
    return np.clip(found, 0, 255)


def probing(config: Config) -> Config:
    """
    Return how frames are looked at that are asked for their tone curve.

    By the usual curve and alone; what lies at another depth is left out as changes are.
    """
    changes = {'camera.gamma': USUAL, 'stream.hold': False, 'layers.enabled': False}
    return config.for_one_frame().replaced(changes)


class ToneSearch:
    """
    The tone curve of the camera that live frames come from.

    Each frame is asked alone, or in a stream that is held the first ones that tell; their median
    then stays.

    Parameters
    ----------
    image : ndarray of shape (M, N) or (M, N, 3), uint8
        The reference.
    hold : bool
        Whether frames are a stream.
    detect : callable
        Looks for changes in a live frame, by the configuration `probing`.

    """

    def __init__(
        self, image: np.ndarray, hold: bool, detect: Callable[[np.ndarray], Result]
    ) -> None:
        self._image = image
        self._hold = hold
        self._detect = detect
        self._found: list[float] = []

    def gamma_for(self, live: np.ndarray) -> float:
        """Return the exponent to take for a live frame, `USUAL` where nothing is known."""
        if len(self._found) < HELD_AFTER:
            result = self._detect(live)
            gamma = None
            if isinstance(result.views, PathFrame):
                gamma = estimated_gamma(result.views, result.change_mask > 0, self._image)
            if not self._hold:
                return gamma or USUAL
            self._found += [gamma] if gamma else []
        return median(self._found) if self._found else USUAL
