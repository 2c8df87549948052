"""
The one code path of node, replay and `rsmb detect`: reference and live frame in, `Result` out.

    coarse start -> camera path -> registered image -> evidence -> objects -> layers -> changes
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from threadpoolctl import ThreadpoolController

from .agreement import agreement
from .camera import Camera
from .coarse import CoarseSearch
from .config import Config
from .errors import FrameError
from .evidence import NoiseTable, evidence
from .layers import DepthSearch, Front, Layer, fronts
from .motion import Grid
from .path_estimator import PathEstimator, PathFit, row_uncertainty
from .photometric import luma, to_display, to_linear
from .render import Window, blurred, rectified
from .sampling import half_pixel
from .segmentation import Blob, blobs, candidates, without_small, without_thin
from .types import NOT_REGISTERED, REGISTERED, Region, Result

MIN_SIZE = 32  # px, smaller frames hold nothing to register by
MIN_CONTRAST = 1.5  # grey levels; an image flatter than this has no texture
BORDER = 5  # px next to the reference's edge that are not judged: interpolation ends there
SATURATED = 254.0  # grey levels; both images at the limit say nothing about each other

_BLAS = ThreadpoolController()


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

    Raises
    ------
    FrameError
        If `reference` is not such an array.

    """

    def __init__(
        self, reference: np.ndarray, camera: Camera | None = None, config: Config = Config()
    ) -> None:
        self.reference = _checked(reference, 'reference')
        self.config = config
        self._camera = camera
        self._executor = ThreadPoolExecutor(config.worker.threads, 'rsmb')
        self._grey = luma(self.reference)
        self._linear = to_linear(self._grey, config.camera.gamma)
        self._fine = half_pixel(self._linear)
        self._stages: dict[tuple[int, int], tuple[Grid, CoarseSearch, PathEstimator]] = {}

    def camera_for(self, width: int) -> Camera:
        """Return the intrinsics used for live frames of `width` px."""
        if self.config.camera.focal_px > 0:
            return Camera(self.config.camera.focal_px)
        return self._camera or Camera.guess(width)

    def detect(self, live: np.ndarray) -> Result:
        """
        Register one live frame and decide what changed.

        Parameters
        ----------
        live : ndarray of shape (M, N) or (M, N, 3), uint8
            Live frame, grey or BGR; its size may differ from the reference's.

        Returns
        -------
        Result
            Never an exception on image content: see `Result.status`.

        Raises
        ------
        FrameError
            If `live` is not such an array.

        """
        live = _checked(live, 'live frame')
        # small systems: a threaded BLAS is slower, and collapses when other processes are busy
        with _BLAS.limit(limits=1, user_api='blas'):
            return self._detect(live)

    def _detect(self, live: np.ndarray) -> Result:
        clock = _Clock()
        grey = luma(live)
        problem = self._without_texture(grey)
        if problem:
            return self._not_registered(live, problem, clock)
        grid, coarse, estimator = self._stages_for(grey.shape)
        with clock.step('coarse'):
            matches = coarse.match(grey)
        with clock.step('path'):
            linear = to_linear(grey, self.config.camera.gamma)
            fit = estimator.estimate(linear, matches)
        with clock.step('render'):
            frame = _RegisteredFrame(self, live, grey, fit)
            problem = self._misfit(frame)
        if problem:
            return self._not_registered(live, problem, clock)
        with clock.step('change'):
            noise, strength, mask = self._evidence(frame)
        layers: list[Layer] = []
        if self.config.layers.enabled and mask.any():
            with clock.step('layers'):
                layers = self._layers(frame, mask, noise)
        if layers:
            with clock.step('refine'):
                frame.put_in_front(layers)
                refined = estimator.refine(linear, fit, frame.foreground)
                frame = _RegisteredFrame(self, live, grey, refined)
                noise, strength, mask = self._evidence(frame)
                layers = self._layers(frame, mask, noise)
                frame.put_in_front(layers)
                noise, strength, mask = self._evidence(frame)
        mask = without_small(without_thin(mask * frame.judged), self.config.change)
        regions = [*self._changes(mask, strength), *map(_static_region, layers)]
        return Result(
            status=REGISTERED,
            reason='',
            change_mask=mask * np.uint8(255),
            valid_mask=frame.judged * np.uint8(255),
            residual=np.where(frame.judged, frame.residual, np.float32(0.0)),
            row_motion=frame.fit.path.row_motion(),
            row_uncertainty=row_uncertainty(frame.fit),
            regions=tuple(regions),
            exposure_rows=frame.fit.path.exposure_rows,
            gain=float(frame.fit.light.gain[0]),
            timings_ms=clock.timings_ms,
            views=frame,
        )

    def _stages_for(self, shape: tuple[int, int]) -> tuple[Grid, CoarseSearch, PathEstimator]:
        """Return what depends on the live frame's size, prepared once per size."""
        if shape not in self._stages:
            grid = Grid(shape, self._grey.shape, self.camera_for(shape[1]).focal_px)
            fraction = self.config.registration.search_fraction
            coarse = CoarseSearch(self._grey, grid, fraction)
            estimator = PathEstimator(self._linear, grid, self.config, self._executor)
            self._stages = {shape: (grid, coarse, estimator)}  # one size at a time: memory
        return self._stages[shape]

    def _without_texture(self, grey: np.ndarray) -> str:
        for name, image in (('reference', self._grey), ('live frame', grey)):
            if float(image.std()) < MIN_CONTRAST:
                return f'no texture in the {name}: contrast {image.std():.2f} < {MIN_CONTRAST} grey levels'
        return ''

    def _misfit(self, frame: _RegisteredFrame) -> str:
        """Say why a fitted frame must not be trusted, '' when it may."""
        limits = self.config.registration
        overlap = float(frame.complete.mean())
        if overlap < limits.min_overlap:
            return f'no overlap: {overlap:.0%} of the frame lies in the reference, {limits.min_overlap:.0%} needed'
        agreed = agreement(frame.predicted, frame.grey, frame.complete)
        if agreed is None:
            return 'no texture where the live frame overlaps the reference'
        if agreed < limits.min_agreement:
            return (
                f'live frame and reference do not match: {agreed:.0%} of the textured blocks agree, '
                f'{limits.min_agreement:.0%} needed'
            )
        return ''

    def _evidence(self, frame: _RegisteredFrame) -> tuple[NoiseTable, np.ndarray, np.ndarray]:
        """Return noise, evidence (M, N) [sigma] and candidate objects (M, N) uint8 0/1."""
        noise = NoiseTable.learn(frame.predicted, frame.residual, frame.judged)
        z = frame.residual / noise(frame.predicted)
        strength = evidence(np.where(frame.judged, z, np.float32(0.0)))
        return noise, strength, candidates(strength, self.config.change)

    def _layers(self, frame: _RegisteredFrame, mask: np.ndarray, noise: NoiseTable) -> list[Layer]:
        """Find the static objects among the candidates in `mask` (M, N) uint8 0/1."""
        search = DepthSearch(
            frame.grey,
            noise,
            frame.render,
            frame.fit.path,
            self.config.layers,
            self.config.change,
        )
        layers = [layer for blob in blobs(mask) if (layer := search.explain(blob))]
        rest = mask.copy()
        for layer in layers:
            rest[layer.blob.box][layer.blob.mask] = 0
        # pieces too small to tell their own depth, next to one that could
        pieces = (search.belongs(blob, layer) for blob in blobs(rest) for layer in layers)
        return layers + [piece for piece in pieces if piece]

    def _changes(self, mask: np.ndarray, strength: np.ndarray) -> Iterator[Region]:
        for blob in blobs(mask):
            peak = float(strength[blob.box][blob.mask].max())
            # 0.5 at the threshold, towards 1 as the evidence grows beyond it
            score = 1.0 - 0.5 * (self.config.change.threshold_high / max(peak, 1e-6)) ** 2
            yield _region(blob, 'change', float(np.clip(score, 0.0, 1.0)), None)

    def _not_registered(self, live: np.ndarray, reason: str, clock: _Clock) -> Result:
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
            views=_BlankViews(self.reference, live),
        )


class _RegisteredFrame:
    """One live frame with its path: everything that is rendered from them."""

    def __init__(self, detector: Detector, live: np.ndarray, grey: np.ndarray, fit: PathFit) -> None:
        self.fit = fit
        self.grey = grey
        self._detector = detector
        self._live = live
        self._fronts: list[Front] = []
        rows, cols = grey.shape
        self.predicted, self.complete = self.render(1.0, Window(0, rows, 0, cols))
        self.residual = grey - self.predicted
        inner = cv2.copyMakeBorder(self.complete.astype(np.uint8), *[1] * 4, cv2.BORDER_CONSTANT)
        inner = cv2.erode(inner, np.ones((BORDER, BORDER), np.uint8))[1:-1, 1:-1] > 0
        self.judged = inner & ~((grey >= SATURATED) & (self.predicted >= SATURATED))

    def put_in_front(self, layers: list[Layer]) -> None:
        """Composite static objects over the background; their edges are no longer judged."""
        self._fronts = fronts(layers, self.fit.path, self.render_cover)
        rows, cols = self.grey.shape
        for front in self._fronts:
            own, complete = self.render(front.relative_depth, Window(0, rows, 0, cols))
            inside = front.inside & complete
            self.predicted[inside] = own[inside]
            self.judged = self.judged & ~front.edge
        self.residual = self.grey - self.predicted

    @property
    def foreground(self) -> np.ndarray:
        """Where layers hide the background or may do so (M, N) bool."""
        return np.any([front.inside | front.edge for front in self._fronts], axis=0)

    @cached_property
    def _gain_field(self) -> np.ndarray:
        return self.fit.light.gain_field(self.grey.shape)

    def render(self, depth: float, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """Display values a layer at `depth` would have in the live frame, and where they hold."""
        detector = self._detector
        linear, complete = blurred(
            detector._fine, self.fit.path, detector._executor, depth, window
        )
        light = linear * self._gain_field[window.box] + np.float32(self.fit.light.bias)
        return to_display(light, detector.config.camera.gamma), complete

    def render_cover(self, cover: np.ndarray, depth: float) -> np.ndarray:
        """Share of the exposure that a mask on the reference's grid covers each live pixel."""
        image, _ = blurred(half_pixel(cover), self.fit.path, self._detector._executor, depth)
        return np.clip(image, 0.0, 1.0)

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it, uint8."""
        detector = self._detector
        if detector.reference.ndim == 2:
            image = self.predicted * self.complete
        else:
            planes = [self._composited(detector.reference[..., c]) for c in range(3)]
            light = np.stack(planes, axis=-1)
            image = self.fit.light.apply(light, detector.config.camera.gamma)
            image *= self.complete[..., None]
        return np.rint(image).astype(np.uint8)

    def _composited(self, plane: np.ndarray) -> np.ndarray:
        """Linear light of one colour plane of the reference, layers in front (M, N)."""
        detector = self._detector
        fine = half_pixel(to_linear(plane, detector.config.camera.gamma))
        image, _ = blurred(fine, self.fit.path, detector._executor)
        for front in self._fronts:
            own, complete = blurred(
                fine, self.fit.path, detector._executor, front.relative_depth
            )
            inside = front.inside & complete
            image[inside] = own[inside]
        return image

    def rectified(self) -> np.ndarray:
        """Return the live image in the geometry of the reference, uint8."""
        return rectified(self._live, self.fit.path, self._detector._executor)


@dataclass(frozen=True)
class _BlankViews:
    """Views of a frame that could not be registered."""

    reference: np.ndarray
    live: np.ndarray

    def registered(self) -> np.ndarray:
        return np.zeros(self.live.shape[:2] + self.reference.shape[2:], np.uint8)

    def rectified(self) -> np.ndarray:
        return np.zeros(self.reference.shape[:2] + self.live.shape[2:], np.uint8)


class _Clock:
    """Times the steps of one frame."""

    def __init__(self) -> None:
        self.timings_ms: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.timings_ms[name] = 1e3 * (time.perf_counter() - begin)


def warm_up(config: Config = Config()) -> None:
    """Compile every kernel once (tens of seconds without numba's cache, about one with it)."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(30, 220, (16, 20), dtype=np.uint8)
    reference = cv2.resize(coarse, (160, 128), interpolation=cv2.INTER_CUBIC)
    result = Detector(reference, config=config).detect(np.roll(reference, 3, axis=1))
    result.rectified  # noqa: B018 - computed on first use


def _checked(image: np.ndarray, name: str) -> np.ndarray:
    ok = isinstance(image, np.ndarray) and image.dtype == np.uint8
    if not ok or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        what = f'{image.dtype} {image.shape}' if isinstance(image, np.ndarray) else type(image).__name__
        raise FrameError(f'{name} is {what}, must be uint8 of shape (M, N) or (M, N, 3) in BGR')
    if min(image.shape[:2]) < MIN_SIZE:
        raise FrameError(
            f'{name} is {image.shape[0]}x{image.shape[1]} px, must be at least {MIN_SIZE}x{MIN_SIZE}'
        )
    return image


def _static_region(layer: Layer) -> Region:
    return _region(layer.blob, 'static', min(1.0, layer.share), layer.relative_depth)


def _region(blob: Blob, kind: str, score: float, depth: float | None) -> Region:
    rows, cols = np.nonzero(blob.mask)
    return Region(
        x=blob.x + int(cols.min()),
        y=blob.y + int(rows.min()),
        width=int(cols.max() - cols.min()) + 1,
        height=int(rows.max() - rows.min()) + 1,
        area=blob.area,
        kind=kind,
        score=score,
        relative_depth=depth,
    )
