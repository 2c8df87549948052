"""Live frames of one size in, frames registered by one camera path each out."""

from __future__ import annotations

import numpy as np

from .agreement import Agreement
from .config import Config
from .frame import PathFrame, RegisteredFrame
from .level_fit import SHARP_ROWS
from .loose_ends import mended
from .motion import Grid
from .path_estimator import PathEstimator
from .path_fit import PathFit
from .points import LiveImage
from .reference import Reference
from .row_refinement import RowRefinement
from .start import StripMatches
from .stream import StreamMemory
from .sweep import held_rows, level_of, swept
from .workers import Workers, beside

# Of the misfit of a frame that was refused: denser knots from the start leave 0.3 to 0.6 of it
# where they are right, 0.98 and more where the frame shows another place or is blurred.
SHAKEN = 0.75
SWEPT = 0.9  # likewise of a frame that has lost rows, above which no path has found them again


class PathStage:
    """Registers live frames of one size to one reference by one camera path a frame."""

    frame_class = PathFrame

    def __init__(self, reference: Reference, grid: Grid, config: Config, executor: Workers) -> None:
        self._reference = reference
        self._executor = executor
        self._estimator = PathEstimator(reference, grid, config, executor)
        self._last: LiveImage | None = None
        self._rows: RowRefinement | None = None
        if config.registration.refine_rows:
            self._rows = RowRefinement(self._estimator, grid, config, executor)

    def frame(
        self, live: np.ndarray, grey: np.ndarray, matches: StripMatches, sharp: bool = False
    ) -> PathFrame:
        """
        Register one live frame, `grey` its grey levels (M, N) float32.

        `sharp` takes it for a frame without blur, whatever is known of the exposure.
        """
        image = self._image(grey)
        fit = self._estimator.estimate(image, matches, SHARP_ROWS if sharp else None)
        return self._framed(live, image, fit)

    def shaken(self, refused: RegisteredFrame, matches: StripMatches) -> PathFrame | None:
        """Register a frame whose rows shake too much for the usual knots; None: it does not."""
        if self._rows is None:
            return None
        assert isinstance(refused, PathFrame)
        image = self._image(refused.grey)
        fit = self._estimator.shaken(image, matches, self._rows.knot_rows)
        frame = self._framed(refused.live, image, fit)
        return frame if frame.fit.cost < SHAKEN * refused.fit.cost else None

    def swept(self, frame: RegisteredFrame, found: Agreement) -> PathFrame | None:
        """
        Register a frame again from the rows in which most blocks agree; None: there is no need.

        It is returned as it is if nothing is gained. `found` is what agrees of the frame.
        """
        assert isinstance(frame, PathFrame)
        held = held_rows(found, len(frame.grey), level_of(self._estimator))
        if held is None:
            return None
        image = self._image(frame.grey)
        fit = swept(frame.fit, image, self._estimator, held, self._executor)
        if fit.cost >= SWEPT * frame.fit.cost:
            return frame
        return self._framed(frame.live, image, fit)

    def following(
        self, live: np.ndarray, grey: np.ndarray, matches: StripMatches, memory: StreamMemory
    ) -> PathFrame:
        """Register the next frame of a stream, see `frame`."""
        image = self._image(grey)
        fit = self._estimator.follow(image, matches, memory)
        return self._framed(live, image, fit)

    def refined(
        self, frame: RegisteredFrame, foreground: np.ndarray, still: float
    ) -> RegisteredFrame:
        """
        Register a frame again without its `foreground` (M, N) bool.

        It is returned as it is where that moves no row that shows the reference by `still` px.
        """
        assert isinstance(frame, PathFrame)
        fit = self._estimator.refine(self._image(frame.grey), frame.fit, foreground)
        if frame.moved(fit.path) < still:
            return frame
        return self.frame_class(self._reference, frame.live, frame.grey, fit, self._executor)

    def look_at(self, grey: np.ndarray) -> None:
        """Prepare what the fit sees of a frame (M, N) float32, for who calls `frame` next."""
        self._estimator.look_at(self._image(grey))

    def _image(self, grey: np.ndarray) -> LiveImage:
        """Return what the fit sees of a frame, that of the last one if it is the same."""
        if self._last is None or self._last.grey is not grey:
            self._last = LiveImage(grey, self._reference.gamma)
        return self._last

    def _framed(self, live: np.ndarray, image: LiveImage, fit: PathFit) -> PathFrame:
        """Return the frame of a fit, its rows followed where that measures better."""

        def build(fit: PathFit) -> PathFrame:
            return self.frame_class(self._reference, live, image.grey, fit, self._executor)

        frame = build(fit)
        if self._rows is None:
            return frame
        # whoever asked for the frame asks that next, and mostly of this one
        waited = beside(self._executor, lambda: frame.likeness)
        followed = mended(self._rows.refined(frame, image, build), image, self._estimator, build)
        if followed is frame:
            waited()
        return followed
