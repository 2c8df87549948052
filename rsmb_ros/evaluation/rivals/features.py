"""Keypoints, tracked corners and the homography that most of them agree on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ..methods import NotRegistered, Registration
from ..warping import mapped, places_of_homography, registration_at

Kind = Literal['orb', 'sift']

ORB_FEATURES = 2000
SIFT_FEATURES = 5000  # strongest; bounds the time on large frames
SIFT_RATIO = 0.75  # Lowe: best distance over second best
RANSAC_PX = 3.0  # reprojection error of an inlier, OpenCV's default
MIN_INLIERS = 12  # fewer agree by chance
MAX_AREA_RATIO = 4.0  # of the frame's outline in the reference, and 1 / this
CORNERS = 1000
CORNER_QUALITY = 0.01  # of the strongest corner
CORNER_DISTANCE = 8  # px between corners
TRACK_WINDOW = (21, 21)  # px, OpenCV's default
TRACK_LEVELS = 3  # pyramid levels above the image, OpenCV's default
TRACK_RETURN_PX = 0.5  # how exactly a corner must come back (method.md section 7)
MIN_TRACKS = 30
MIN_AGREEING = (
    0.5  # share of the tracks that a fit explains; chance tracks are short and agree, too
)
SEED = 20170301


@dataclass(frozen=True)
class Pairs:
    """n points seen in both images."""

    live: np.ndarray  # (n, 2) float64, x, y [px]
    reference: np.ndarray  # (n, 2) float64, x, y [px]

    def __len__(self) -> int:
        return len(self.live)

    def __getitem__(self, keep: np.ndarray) -> Pairs:
        return Pairs(self.live[keep], self.reference[keep])


def as_uint8(image: np.ndarray) -> np.ndarray:
    """Grey levels (M, N) float32 as OpenCV's detectors want them, uint8."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def matched_keypoints(reference: np.ndarray, live: np.ndarray, kind: Kind) -> Pairs:
    """Match the keypoints of two images (M', N') and (M, N) float32 [grey levels]."""
    detector = cv2.ORB_create(ORB_FEATURES) if kind == 'orb' else cv2.SIFT_create(SIFT_FEATURES)
    live_points, live_words = detector.detectAndCompute(as_uint8(live), None)
    ref_points, ref_words = detector.detectAndCompute(as_uint8(reference), None)
    if min(len(live_points), len(ref_points)) < 2:
        return Pairs(np.empty((0, 2)), np.empty((0, 2)))
    matches = _cross_checked if kind == 'orb' else _distinctive
    pairs = matches(live_words, ref_words)
    return Pairs(
        np.array([live_points[match.queryIdx].pt for match in pairs]).reshape(-1, 2),
        np.array([ref_points[match.trainIdx].pt for match in pairs]).reshape(-1, 2),
    )


def _cross_checked(words: np.ndarray, others: np.ndarray) -> list[cv2.DMatch]:
    """Matches that are each other's nearest by Hamming distance."""
    return list(cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(words, others))


def _distinctive(words: np.ndarray, others: np.ndarray) -> list[cv2.DMatch]:
    """Matches much nearer than the second nearest (Lowe's ratio test)."""
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words, others, k=2)
    return [m[0] for m in nearest if len(m) == 2 and m[0].distance < SIFT_RATIO * m[1].distance]


def robust_homography(pairs: Pairs, shape: tuple[int, int]) -> np.ndarray:
    """
    Homography (3, 3) from live to reference pixels by RANSAC.

    Raises
    ------
    NotRegistered
        If too few pairs agree, or on a mirrored, folded or strongly scaled frame of `shape` (M, N).

    """
    if len(pairs) < MIN_INLIERS:
        raise NotRegistered(f'{len(pairs)} matches, need {MIN_INLIERS}')
    cv2.setRNGSeed(SEED)
    h, inlier = cv2.findHomography(pairs.live, pairs.reference, cv2.RANSAC, RANSAC_PX)
    count = 0 if h is None else int(inlier.sum())
    if count < MIN_INLIERS:
        raise NotRegistered(f'{count} of {len(pairs)} matches agree, need {MIN_INLIERS}')
    h = np.asarray(h, np.float64)
    check_outline(h, shape)
    return h


def check_outline(h: np.ndarray, shape: tuple[int, int]) -> None:
    """Refuse a homography under which a frame of `shape` (M, N) cannot look the same."""
    rows, cols = shape
    x, y = np.array([[0, cols, cols, 0], [0, 0, rows, rows]], np.float64)
    corners = mapped(h, x, y)
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    convex = bool((sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0] > 0).all())
    following = np.roll(corners, -1, axis=0)
    area = (corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum() / 2
    ratio = float(area / (rows * cols))
    if not convex or not 1 / MAX_AREA_RATIO < ratio < MAX_AREA_RATIO:
        raise NotRegistered(f'homography folds the frame or scales its area by {ratio:.3g}')


def keypoint_homography(reference: np.ndarray, live: np.ndarray, kind: Kind) -> np.ndarray:
    """Homography (3, 3) from live to reference pixels by keypoints; may raise NotRegistered."""
    return robust_homography(matched_keypoints(reference, live, kind), live.shape)


def tracked_corners(reference: np.ndarray, live: np.ndarray) -> Pairs:
    """
    Corners of the reference tracked into the live frame and back (pyramidal Lucas-Kanade).

    Tracks start where an ORB homography puts them, else where they are in the reference.

    Raises
    ------
    NotRegistered
        If fewer than ``MIN_TRACKS`` corners come back to where they were.

    """
    old, new = as_uint8(reference), as_uint8(live)
    corners = cv2.goodFeaturesToTrack(old, CORNERS, CORNER_QUALITY, CORNER_DISTANCE)
    if corners is None:
        raise NotRegistered('no corners in the reference')
    corners = corners.reshape(-1, 1, 2)
    rows, cols = np.maximum(old.shape, new.shape)
    old, new = _grown(old, rows, cols), _grown(new, rows, cols)
    try:
        to_reference = keypoint_homography(reference, live, 'orb')
    except NotRegistered:
        to_reference = np.eye(3)
    seen, found = _track(old, new, corners, np.linalg.inv(to_reference))
    back, returned = _track(new, old, seen, to_reference)
    near = np.linalg.norm(back - corners, axis=2)[:, 0] <= TRACK_RETURN_PX
    pairs = Pairs(seen[:, 0].astype(np.float64), corners[:, 0].astype(np.float64))
    within = ((pairs.live >= 0) & (pairs.live <= np.array(live.shape[::-1]) - 1)).all(axis=1)
    pairs = pairs[found & returned & near & within]
    if len(pairs) < MIN_TRACKS:
        raise NotRegistered(f'{len(pairs)} of {len(corners)} corners tracked, need {MIN_TRACKS}')
    return pairs


def _grown(image: np.ndarray, rows: int, cols: int) -> np.ndarray:
    """Continue an image at the bottom and right: OpenCV tracks between equal sizes only."""
    below, right = rows - image.shape[0], cols - image.shape[1]
    return cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REPLICATE)


def check_agreement(errors: np.ndarray) -> None:
    """Refuse a fit whose reprojection errors (n,) [px] are small for too few tracks."""
    count = int(np.count_nonzero(errors < RANSAC_PX))
    need = max(MIN_TRACKS, round(MIN_AGREEING * len(errors)))
    if count < need:
        raise NotRegistered(f'{count} of {len(errors)} tracks agree, need {need}')


def _track(
    old: np.ndarray, new: np.ndarray, points: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Track points (n, 1, 2) float32 that start at `guess` (3, 3); places and found (n,) bool."""
    start = mapped(guess, points[..., 0], points[..., 1]).astype(np.float32)
    places, status, _ = cv2.calcOpticalFlowPyrLK(
        old,
        new,
        points,
        start,
        winSize=TRACK_WINDOW,
        maxLevel=TRACK_LEVELS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return places.reshape(-1, 1, 2), status.ravel().astype(bool)


@dataclass(frozen=True)
class HomographyRegistrar:
    """One homography for the whole frame, from matched keypoints."""

    name: Kind

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """Register a frame; see `Registrar`."""
        h = keypoint_homography(reference, live, self.name)
        return registration_at(places_of_homography(h, live.shape), reference)
