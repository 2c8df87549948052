"""What the frames of a stream teach about the next one: exposure, defocus, light, place."""

from __future__ import annotations

from collections import deque

import numpy as np

from .path_fit import PathFit

CALIBRATION = 10  # frames, after which the exposure is held
REMEMBERED = 30  # frames whose exposures are weighed; a camera's settings may change in flight
LEAST_ERROR = 0.01  # relative; no frame's exposure is trusted further than this
CHANGED = 0.1  # relative; a frame's own exposure this far off, and ...
CERTAIN = 4.0  # ... so many standard deviations: the camera's settings have changed
RESTED = 10  # frames after a sweep in vain until the next: a large change stays where it is
WORSE = 1.3  # cost over the usual one, above which a held frame is tried from nothing


class StreamMemory:
    """Exposure and last fit of the frames of one size against one reference."""

    def __init__(self) -> None:
        self._exposures: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)  # rows, weight
        self._costs: deque[float] = deque(maxlen=REMEMBERED)
        self.last: PathFit | None = None
        self._lost = True
        self._resting = 0  # frames until the next sweep

    @property
    def place(self) -> np.ndarray | None:
        """Where the last frame lay, see `CameraPath.offset`; None when it was not registered."""
        return None if self._lost or self.last is None else self.last.path.offset

    @property
    def exposure_rows(self) -> float | None:
        """Weighted median of the frames' own exposures [rows]; None before the first frame."""
        if not self._exposures:
            return None
        values, weights = np.array(self._exposures).T
        order = np.argsort(values)
        share = np.cumsum(weights[order]) - 0.5 * weights[order]
        return float(np.interp(0.5 * weights.sum(), share, values[order]))

    @property
    def calibrated(self) -> bool:
        """Whether the exposure is known well enough to be held."""
        return len(self._exposures) >= CALIBRATION

    def plausible(self, fit: PathFit) -> bool:
        """Whether a fit that started from this memory is as good as fits usually were."""
        usual = float(np.median(self._costs)) if self._costs else np.inf
        return fit.cost <= WORSE * usual and not self._changed(fit)

    def _changed(self, fit: PathFit) -> bool:
        """Whether a frame's own exposure contradicts the held one."""
        held = self.exposure_rows
        if held is None or not self.calibrated:
            return False
        off = abs(fit.own_exposure - held)
        return off > max(CHANGED * held, CERTAIN * fit.own_exposure_sigma)

    def rested(self) -> bool:
        """Whether a frame that seems to have lost rows is worth a sweep; asked once a frame."""
        self._resting = max(0, self._resting - 1)
        return self._resting == 0

    def swept_in_vain(self) -> None:
        """Remember that a sweep led nowhere."""
        self._resting = RESTED

    def learn(self, first: PathFit, fit: PathFit) -> None:
        """Remember a registered frame: its `first` fit, and that without what is no ground."""
        if self._changed(fit):
            self._exposures.clear()
            self._costs.clear()
        error = max(LEAST_ERROR * fit.own_exposure, fit.own_exposure_sigma)
        if np.isfinite(error) and error > 0:
            self._exposures.append((fit.own_exposure, 1.0 / error**2))
        self._costs.append(first.cost)
        self.last = fit
        self._lost = False

    def lose(self) -> None:
        """Forget where the last frame was; what is known of the camera stays."""
        self._lost = True
