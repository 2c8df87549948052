"""
From a registered frame to what changed: evidence, static objects, and the path without them.

Static objects bend the path that they were registered with; it is fitted again without them until
it stands. Where they outdo the ground over many rows it is tried the other way round, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import cv2
import numpy as np

from .clock import Clock
from .colour import ColourEvidence
from .config import Config
from .depth_search import DepthSearch
from .entropy import entropy_candidates
from .evidence import EVIDENCE_WINDOW, OUTLINE_WINDOW, NoiseTable, Texture, box_rms
from .frame import RegisteredFrame
from .layers import Layer
from .lost_rows import row_agreement, row_doubts, unlike_rows
from .motion import CameraPath
from .path_stage import PathStage
from .refused import Refused
from .row_frame import RowStage
from .segmentation import blobs, candidates, outline_level
from .workers import Workers, beside, each

# Share of the frame that must misfit before the path is fitted again without it: an object whose
# texture outdoes the ground's has bent the path, and no single depth then explains it.
LARGE_MISFIT = 0.02
REFITS = 3  # at most: where much of a frame is no ground, one is not enough
LAST_LOOKS = 4  # at most, for static objects that only show when others are explained
STILL = 0.2  # px; a fit that moves no row further is not worth another look
NEAR = 0.5  # px; a fit that has moved no row further is not repeated without ...
SAME = 0.9  # of what two fits were to leave out, over which they leave out the same
STATIC_COST = 0.3  # of a pixel that another depth explains against one that nothing does
AS_MUCH = 0.98  # of what one path sees of the reference another must see
LOST = 3.0  # px, standard deviation of the place of a row that is not judged
OUTLINED = 3.0  # times weaker than colour is brightness where colour draws the outline
DOUBT = 0.15  # share of a row left unexplained, over DOUBT_ROWS rows: the path may be another's
DOUBT_ROWS = 25  # at 480 rows


@dataclass(frozen=True)
class Seen:
    """What a frame's residual says."""

    noise: NoiseTable
    colour: ColourEvidence | None  # None where one of the images is grey
    strength: np.ndarray  # (M, N) float32 [sigma]
    mask: np.ndarray  # (M, N) uint8 0/1, candidate objects
    squares: np.ndarray  # (M, N) float32, of the normalised residual, truncated
    outline: float  # evidence that the outline of an object is drawn at [sigma]

    @cached_property
    def sharp(self) -> np.ndarray:
        """
        Evidence over a smaller window (M, N) float32 [sigma], 0 far from all candidates.

        However strong a residual is, `outline` is reached where it fills half of the window: it
        does not widen its object.
        """
        left, top, width, height = cv2.boundingRect(self.mask)
        reach = EVIDENCE_WINDOW  # at the edge of the box it sees less, but no candidate does
        box = np.s_[
            max(0, top - reach) : top + height + reach, max(0, left - reach) : left + width + reach
        ]
        squares = self.squares[box]
        sharp = np.zeros(self.mask.shape, np.float32)
        sharp[box] = box_rms(np.minimum(squares, 2.0 * self.outline**2), OUTLINE_WINDOW)
        if self.colour is not None:
            # brightness has the finer outline, wherever there is one
            colour = self.colour.sharp[box]
            dim = box_rms(squares) < colour / OUTLINED
            np.maximum(sharp[box], colour, out=sharp[box], where=dim)
        return sharp


@dataclass(frozen=True)
class Finding:
    """A frame whose path stands, with what was found in it."""

    frame: RegisteredFrame
    seen: Seen
    layers: tuple[Layer, ...]
    doubtful: np.ndarray  # (M,) bool, rows whose path may follow something else than the ground
    lost: np.ndarray | None = None  # (M,) bool, rows at which the path does not lie; None: none

    @property
    def not_ground(self) -> float:
        """Share of the frame that is explained by another depth, or worse, by nothing."""
        static = sum(layer.blob.area for layer in self.layers) / self.seen.mask.size
        return STATIC_COST * static + float((self.seen.mask * self.frame.judged).mean())

    def better_than(self, other: Finding) -> bool:
        """Whether more of the frame is ground, not for want of a reference to compare it with."""
        if self.frame.complete.mean() < AS_MUCH * other.frame.complete.mean():
            return False
        return self.not_ground < other.not_ground


class ChangeFinder:
    """Decides what in a registered frame is new, and what was there at another depth."""

    def __init__(self, config: Config, executor: Workers) -> None:
        self._config = config
        self._executor = executor

    def find(self, stage: PathStage | RowStage, frame: RegisteredFrame, clock: Clock) -> Finding:
        """Return what is in a frame; its path may be fitted again by its `stage`."""
        refused = Refused()
        finding = self._settled(stage, frame, clock, refused)
        assert finding is not None  # nothing was tried before
        # of two planes nothing tells which is the ground where no depth may explain the other
        if finding.doubtful.any() and self._config.layers.enabled:
            tried = finding.frame.path
            with clock.step('other way'):
                # perhaps what fits in these rows is not the ground
                ground = finding.doubtful[:, None] & (finding.seen.mask == 0)
                other = stage.refined(finding.frame, ground, STILL)
            if other is not finding.frame:
                rival = self._settled(stage, other, clock, refused, tried)
                if rival is not None and rival.better_than(finding):
                    finding = rival
        frame, rows = finding.frame, len(finding.frame.grey)
        lost = unlike_rows(row_agreement(frame.predicted, frame.grey, frame.complete), rows)
        ground = frame.complete & (finding.seen.mask == 0)  # as far as that is told
        doubts = row_doubts(row_agreement(frame.predicted, frame.grey, ground), rows)
        frame.doubt(np.where(lost, np.inf, doubts))
        return replace(finding, lost=lost) if lost.any() else finding

    def _settled(
        self,
        stage: PathStage | RowStage,
        frame: RegisteredFrame,
        clock: Clock,
        refused: Refused,
        tried: CameraPath | None = None,
    ) -> Finding | None:
        """
        Find static objects and fit again without them until the path stands.

        None where that leads to a path that was `tried` before, and to no static object.
        """
        with clock.step('change'):
            self._match_tones(frame)
            seen = self._evidence(frame)
        layers: list[Layer] = []
        known: list[Layer] = []  # at the last search
        left_out, moved = np.zeros(seen.mask.shape, bool), np.inf  # by the last fit
        if self._config.layers.enabled and seen.mask.any():
            with clock.step('layers'):
                layers = self._layers(frame, seen, refused)
        for _ in range(REFITS):
            foreground = self._foreground(frame, seen, layers)
            if not foreground.any():
                break
            if moved < NEAR and _overlap(foreground, left_out) > SAME:
                break
            left_out = foreground
            # what is known not to be ground must not have bent the path
            with clock.step('refine'):
                before, frame = frame, stage.refined(frame, foreground, STILL)
                if frame is before:  # and so are the static objects
                    if layers:
                        frame.put_in_front(layers)
                        seen = self._evidence(frame)
                    break
                if tried is not None and not layers and frame.moved(tried) < STILL:
                    return None
                self._match_tones(frame)
                moved = frame.moved(before.path)
                seen = self._evidence(frame)
            if self._config.layers.enabled:
                with clock.step('layers again'):
                    known, layers = layers, self._layers(frame, seen, refused, layers)
                    if layers:
                        frame.put_in_front(layers)
                        seen = self._evidence(frame)
        doubtful = _doubtful_rows(seen.mask * frame.judged)
        if known or layers:
            with clock.step('layers again'):
                seen = self._last_look(frame, seen, refused, layers)
        return Finding(frame, seen, tuple(layers), doubtful)

    def _last_look(
        self, frame: RegisteredFrame, seen: Seen, refused: Refused, layers: list[Layer]
    ) -> Seen:
        """
        Search what stands out once the static objects are in front; `layers` grows by it.

        With them gone the frame's noise is less, and what it had hidden has not been asked yet.
        """
        for _ in range(LAST_LOOKS):
            more = self._layers(frame, seen, refused, layers) if seen.mask.any() else []
            if not more:
                break
            layers += more
            frame.put_in_front(layers)
            seen = self._evidence(frame)
        return seen

    @staticmethod
    def _foreground(frame: RegisteredFrame, seen: Seen, layers: list[Layer]) -> np.ndarray:
        """Where the frame shows no ground for sure (M, N) bool: static objects, large misfits."""
        mask = frame.foreground(layers)
        if mask.any() or seen.mask.mean() > LARGE_MISFIT:
            mask |= seen.mask > 0
        return mask

    def _match_tones(self, frame: RegisteredFrame) -> None:
        waited = beside(self._executor, lambda: frame.row_uncertainty)  # is asked next
        if self._config.photometric.tones:
            frame.match_tones()
        waited()

    def _evidence(self, frame: RegisteredFrame) -> Seen:
        place = np.nan_to_num(frame.row_uncertainty, posinf=LOST).astype(np.float32)
        frame.judged[place >= LOST] = False
        colours, colour = frame.colours, None
        if colours is not None:
            by_colour = partial(
                ColourEvidence.of, frame.live, colours, frame.judged, frame.misfit, place,
                self._executor,
            )  # fmt: skip
            waited = beside(self._executor, by_colour)
        texture = Texture.of(frame.predicted)
        noise = NoiseTable.learn(texture, frame.residual, frame.judged)
        z2 = noise.surprise(texture, frame.residual, frame.judged, frame.misfit, place)
        strength, change = box_rms(z2), self._config.change
        if colours is not None:
            colour = waited()
            strength = np.maximum(strength, colour.strength)
        if change.segmentation == 'entropy':
            mask = entropy_candidates(frame.residual, frame.judged, change)
        else:
            mask = candidates(strength, change)
        return Seen(noise, colour, strength, mask, z2, outline_level(change))

    def _layers(
        self,
        frame: RegisteredFrame,
        seen: Seen,
        refused: Refused,
        known: Sequence[Layer] = (),
    ) -> list[Layer]:
        """Find the static objects among the candidates; `refused` learns which are none."""
        config = self._config
        search = DepthSearch(
            frame,
            seen.noise,
            frame.energy(seen.noise),
            seen.colour.limit if seen.colour else None,
            _standing_out(frame, seen, known),
            config.layers,
            config.change,
            refused,
        )
        explain = partial(search.explain, known=known)
        found = each(self._executor, explain, blobs(seen.mask), lambda blob: blob.mask.size)
        layers = list(filter(None, found))
        rest = seen.mask.copy()
        for layer in layers:
            rest[layer.blob.box][layer.blob.mask] = 0
        # pieces too small to tell their own depth, next to one that could
        pieces = (search.belongs(blob, layer) for blob in blobs(rest) for layer in layers)
        return layers + [piece for piece in pieces if piece]


def _standing_out(frame: RegisteredFrame, seen: Seen, known: Sequence[Layer]) -> np.ndarray:
    """Where the ground does not explain a frame, or is not asked (M, N) bool."""
    marked = (seen.mask > 0) | ~frame.judged
    for layer in known:
        marked[layer.blob.box] |= layer.blob.mask
    return marked


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Return how much of two masks (M, N) bool is in both, 0..1."""
    return float(np.count_nonzero(one & other) / max(1, np.count_nonzero(one | other)))


def _doubtful_rows(unexplained: np.ndarray) -> np.ndarray:
    """Rows (M,) of which so much (M, N) is unexplained that the path may follow something else."""
    share = unexplained.mean(axis=1, dtype=np.float32)
    rows = max(3, round(DOUBT_ROWS * len(share) / 480))
    return cv2.blur(share[:, None], (1, rows))[:, 0] > DOUBT
