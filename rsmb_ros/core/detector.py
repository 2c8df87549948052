"""
The one code path of node, replay and `rsmb detect`: reference and live frame in, `Result` out.

    coarse start -> camera path -> registered image -> evidence -> objects -> layers -> changes
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from threadpoolctl import ThreadpoolController

from .camera import Camera
from .change_finder import ChangeFinder
from .checks import checked_image, checked_layers
from .clock import Clock
from .coarse import CoarseSearch, sub_pixel_peak
from .config import Config
from .features import FeatureSearch
from .frame import PathFrame, RegisteredFrame
from .layered_frame import LayeredStage
from .layers import Layer, Place
from .motion import Grid
from .outcome import BlankViews, Outcome, outcome_of, remembered
from .path_stage import PathStage
from .persistence import RegionMemory
from .photometric import luma
from .reference import Reference
from .row_frame import RowStage
from .segmentation import Blob
from .start import StripMatches
from .stream import StreamMemory
from .tone import USUAL, ToneSearch, probing
from .types import NOT_REGISTERED, Result
from .verdict import Verdict, problem_of_rest, verdict_on
from .workers import beside, workers

MIN_CONTRAST = 1.5  # grey levels; an image flatter than this has no texture
# Misfit of a swept frame over that before, up to 0.75 where rows were found again, above 0.86 where
# they were not.
FOUND_AGAIN = 0.8
NO_SEARCH = {'layers.enabled': False}  # of depths, where they are known

_BLAS = ThreadpoolController()
_Stages = tuple[CoarseSearch, FeatureSearch, 'PathStage | RowStage']


class Detector:
    """
    Finds what changed between one reference and live frames of a rolling-shutter camera.

    Parameters
    ----------
    reference : ndarray of shape (M, N) or (M, N, 3), uint8
        Clean reference; grey or BGR.
    camera : Camera, optional
        Intrinsics of the live camera; `config.camera.focal_px` goes before it, a guess comes last.
    config : Config
        All parameters.
    depth : ndarray of shape (M, N), float32, optional
        Relative depth ``d_l`` of each reference pixel, background = 1, nearer < 1, 0.05 to 20; NaN
        where it is not known: what is there is never judged. All layers are then registered and
        rendered at once (Eq. 6-10), and no depths are searched.

    Notes
    -----
    Every frame stands alone, unless `config.stream.hold`: then frames are taken for a stream, and
    what one teaches about the camera helps the next; or `config.change.persistence_frames` > 1:
    then only changes that several frames show at one place of the reference are reported. Equal
    sequences still give equal results.

    Raises
    ------
    FrameError
        If `reference` or `depth` is not such an array.
    ConfigError
        If there is a `depth` and ``registration.estimator`` is ``rows``.

    """

    def __init__(
        self,
        reference: np.ndarray,
        camera: Camera | None = None,
        config: Config = Config(),
        depth: np.ndarray | None = None,
    ) -> None:
        self.reference = checked_image(reference, 'reference')
        self.config = config
        self._camera = camera
        layers = None if depth is None else checked_layers(depth, self.reference, config)
        self._executor = workers(config.worker.threads)
        searched = config if layers is None else config.replaced(NO_SEARCH)
        self._finder = ChangeFinder(searched, self._executor)
        self._reference = Reference(self.reference, config.camera.gamma or USUAL, layers)
        self._tones: ToneSearch | None = None
        if config.camera.gamma == 0 and config.registration.estimator == 'path':
            probe = Detector(reference, camera, probing(config), depth)
            self._tones = ToneSearch(self.reference, config.stream.hold, probe.detect)
        self._stages: dict[tuple[int, int], _Stages] = {}
        self._memory = StreamMemory()
        self._regions = RegionMemory(config.change)

    @property
    def gamma(self) -> float:
        """Exponent of the tone curve of the last frame, given or estimated."""
        return self._reference.gamma

    def _show_by(self, gamma: float) -> None:
        """Take another tone curve from now on."""
        if gamma != self._reference.gamma:
            self._reference = Reference(self.reference, gamma, self._reference.depth)
            self._stages = {}

    def camera_for(self, width: int) -> Camera:
        """Return the intrinsics used for live frames of `width` px."""
        if self.config.camera.focal_px > 0:
            return Camera(self.config.camera.focal_px)
        return self._camera or Camera.guess(width)

    def detect(self, live: np.ndarray, stamp: int | None = None) -> Result:
        """
        Register one live frame and decide what changed.

        Parameters
        ----------
        live : ndarray of shape (M, N) or (M, N, 3), uint8
            Live frame, grey or BGR; its size may differ from the reference's.
        stamp : int, optional
            When it was taken [ns]; only kept, as `Region.first_seen`.

        Returns
        -------
        Result
            Never an exception on image content: see `Result.status`.

        Raises
        ------
        FrameError
            If `live` is not such an array.

        """
        return remembered(self.detect_alone(live), self._regions, stamp)

    def detect_alone(self, live: np.ndarray) -> Outcome:
        """
        Do all of `detect` that needs no memory of regions, and leave that as it is.

        For who detects frames in several processes and lets `remembered` follow in their order.
        """
        live = checked_image(live, 'live frame')
        # small systems: a threaded BLAS is slower, and collapses when other processes are busy
        with _BLAS.limit(limits=1, user_api='blas'):
            return self._detect(live)

    def _detect(self, live: np.ndarray) -> Outcome:
        clock = Clock()
        grey = luma(live)
        problem = self._without_texture(grey)
        if problem:
            return Outcome(self._not_registered(live, problem, clock))
        if self._tones:
            with clock.step('tone curve'):
                self._show_by(self._tones.gamma_for(live))
        coarse, features, stage = self._stages_for(grey.shape)
        following = self._following(coarse, stage, live, grey, clock)
        frame: RegisteredFrame
        if following is not None:
            frame, verdict = following
        else:
            with clock.step('coarse'):
                matches = self._matched(coarse, stage, grey)
            with clock.step('registration'):
                frame = stage.frame(live, grey, matches)
                verdict = self._verdict(frame)
        with clock.step('second start' if verdict.problem else 'registration'):
            found: RegisteredFrame | None = None
            if verdict.problem:
                others = (
                    self._second_start(stage, live, grey, features.match(grey)),
                    self._shaken(stage, frame, matches),
                )
                found = min(filter(None, others), key=lambda one: one.cost, default=None)
            # last, for a sweep goes on from what it has, right or not
            found = found or self._swept(stage, frame, verdict)
        if verdict.problem and not found:
            return Outcome(self._not_registered(live, verdict.problem, clock))
        frame = found or frame
        finding = self._finder.find(stage, frame, clock)
        if finding.lost is not None:
            needed = self.config.registration.min_agreement
            problem = problem_of_rest(finding.frame, grey, finding.lost, needed)
            if problem:
                return Outcome(self._not_registered(live, problem, clock))
        if self.config.stream.hold and isinstance(finding.frame, PathFrame):
            assert isinstance(frame, PathFrame)
            self._memory.learn(frame.fit, finding.frame.fit)
        return outcome_of(finding, self.config.change, self._executor, clock)

    def _following(
        self,
        coarse: CoarseSearch,
        stage: PathStage | RowStage,
        live: np.ndarray,
        grey: np.ndarray,
        clock: Clock,
    ) -> tuple[PathFrame, Verdict] | None:
        """Register from where the last frame was; None where that does not lead anywhere."""
        if self._memory.last is None or isinstance(stage, RowStage):
            return None
        place = self._memory.place
        self._memory.lose()  # until this frame is registered
        with clock.step('coarse'):
            matches = self._matched(coarse, stage, grey, place)
        with clock.step('registration'):
            frame = stage.following(live, grey, matches, self._memory)
            verdict = self._verdict(frame)
        good = self._memory.plausible(frame.fit) and not verdict.problem
        return (frame, verdict) if good else None

    def _matched(
        self,
        coarse: CoarseSearch,
        stage: PathStage | RowStage,
        grey: np.ndarray,
        near: np.ndarray | None = None,
    ) -> StripMatches:
        """Match coarsely, while another thread looks at the frame for the fit."""
        looked = beside(self._executor, partial(stage.look_at, grey))
        matches = coarse.match(grey, near)
        looked()
        return matches

    def _second_start(
        self,
        stage: PathStage | RowStage,
        live: np.ndarray,
        grey: np.ndarray,
        matches: StripMatches | None,
    ) -> RegisteredFrame | None:
        """Register from feature matches; None when that may not be trusted either."""
        if matches is None:
            return None
        # where a scene is no plane, blur hides what does not fit: try without as well
        frames = (stage.frame(live, grey, matches, sharp) for sharp in (False, True))
        fitting = [frame for frame in frames if not self._verdict(frame).problem]
        return min(fitting, key=lambda frame: frame.cost, default=None)

    def _shaken(
        self, stage: PathStage | RowStage, refused: RegisteredFrame, matches: StripMatches
    ) -> RegisteredFrame | None:
        """Register a frame that may shake too much for the first start; None when it does not."""
        frame = stage.shaken(refused, matches)
        return None if frame is None or self._verdict(frame).problem else frame

    def _swept(
        self, stage: PathStage | RowStage, fitted: RegisteredFrame, verdict: Verdict
    ) -> RegisteredFrame | None:
        """Register a frame again that has lost some of its rows; None when it has not."""
        rested = self._memory.rested() or not self.config.stream.hold or verdict.problem
        if verdict.found is None or not rested:
            return None
        frame = stage.swept(fitted, verdict.found)
        if frame is None:
            return None
        if frame is not fitted:
            again = self._verdict(frame)
            if not again.problem and again.misfit(frame) < FOUND_AGAIN * verdict.misfit(fitted):
                return frame
        self._memory.swept_in_vain()
        return None

    def _stages_for(self, shape: tuple[int, int]) -> _Stages:
        """Return what depends on the live frame's size, prepared once per size."""
        if shape not in self._stages:
            grid = Grid(shape, self._reference.grey.shape, self.camera_for(shape[1]).focal_px)
            fraction = self.config.registration.search_fraction
            coarse = CoarseSearch(self._reference.grey, grid, fraction, self._executor)
            config = self.config.replaced({'camera.gamma': self.gamma})
            stage = self._stage_class(self._reference, grid, config, self._executor)
            features = FeatureSearch(self._reference.grey, grid)
            self._stages = {shape: (coarse, features, stage)}  # one size at a time: memory
            self._memory = StreamMemory()
        return self._stages[shape]

    @property
    def _stage_class(self) -> type[PathStage] | type[RowStage]:
        if self.config.registration.estimator == 'rows':
            return RowStage
        return PathStage if self._reference.depth is None else LayeredStage

    def _without_texture(self, grey: np.ndarray) -> str:
        contrasts = {'reference': self._reference.contrast, 'live frame': float(grey[::4].std())}
        for name, contrast in contrasts.items():
            if contrast < MIN_CONTRAST:
                return (
                    f'no texture in the {name}: '
                    f'contrast {contrast:.2f} < {MIN_CONTRAST} grey levels'
                )
        return ''

    def _verdict(self, frame: RegisteredFrame) -> Verdict:
        return verdict_on(frame, self.config.registration)

    def _not_registered(self, live: np.ndarray, reason: str, clock: Clock) -> Result:
        rows = live.shape[0]
        blank = np.zeros(live.shape[:2], np.uint8)
        return Result(
            status=NOT_REGISTERED,
            reason=reason,
            change_mask=blank,
            valid_mask=blank.copy(),
            residual=np.zeros(live.shape[:2], np.float32),
            row_motion=np.full((rows, 6), np.nan),
            row_uncertainty=np.full(rows, np.nan),
            regions=(),
            exposure_rows=float('nan'),
            gain=float('nan'),
            timings_ms=clock.timings_ms,
            views=BlankViews(self.reference, live),
        )


def warm_up(config: Config = Config(), depth: bool = False) -> None:
    """
    Compile every kernel once (tens of seconds without numba's cache, about one with it).

    With `depth` those of a known depth, which are others.
    """
    rng = np.random.default_rng(0)
    coarse = rng.integers(30, 220, (16, 20), dtype=np.uint8)
    reference = cv2.resize(coarse, (160, 128), interpolation=cv2.INTER_CUBIC)
    reference[60:70, 60:70] = 255  # what is clipped is rendered, too
    reference = cv2.merge([reference] * 3)
    layers = np.ones(reference.shape[:2], np.float32)
    layers[40:80, 50:100] = 0.8
    detector = Detector(reference, config=config, depth=layers if depth else None)
    live = np.roll(reference, 3, axis=1)
    live[84:114, 20:60] = 255 - live[84:114, 20:60]  # depths are searched for what is new
    result = detector.detect(live)
    result.rectified  # noqa: B018 - computed on first use
    luma(np.dstack([reference] * 3))  # nothing here has colours ...
    sub_pixel_peak(np.zeros((3, 3), np.float32))  # ... or loose ends
    if isinstance(result.views, RegisteredFrame):
        mask = np.ones((8, 8), bool)  # nothing here is at another depth by itself
        result.views.foreground([Layer(Blob(mask, 60, 60), mask, Place(0.8), 1.0)])
