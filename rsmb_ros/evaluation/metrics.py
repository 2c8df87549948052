"""How well a method did on one case: pixels, objects, registration, time."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment
from skimage.measure import label as components
from skimage.metrics import mean_squared_error, peak_signal_noise_ratio
from sklearn.metrics import confusion_matrix

from rsmb_ros.core.photometric import luma

from .case import Case
from .matching import TOUCH_PX
from .methods import Outcome, Registration
from .statics import StaticObject, static_objects
from .true_path import TruePrediction

CHANGED, UNCHANGED, RIM, OUTSIDE = 255, 0, 170, 85  # labels of CDnet (Goyette et al. 2012)
# Share of the frame, 80 px at 640x480: what ignored pixels leave of a region or an object is
# dropped below it. Not `config.change.min_area`: a yardstick must not follow what it measures.
LEFTOVER = 2.6e-4
NAN = math.nan


@dataclass(frozen=True)
class PixelScores:
    """CDnet's seven and IoU, over the pixels whose label is not ignored; NaN where undefined."""

    recall: float = NAN  # 0..1
    specificity: float = NAN  # 0..1
    fpr: float = NAN  # false positive rate, 0..1
    fnr: float = NAN  # false negative rate, 0..1
    pwc: float = NAN  # percentage of wrong classifications [%]
    precision: float = NAN  # 0..1
    f: float = NAN  # F-measure, 0..1
    iou: float = NAN  # 0..1
    judged: float = NAN  # share of these pixels the method calls valid, 0..1


@dataclass(frozen=True)
class ObjectScores:
    """Counts of one image, so that a suite can sum them."""

    tp: int  # objects with a region of their own
    fp: int  # regions without an object of their own
    fn: int  # objects without a region of their own
    false_alarms: int  # regions that do not even touch a change


@dataclass(frozen=True)
class RegistrationScores:
    """Errors on unchanged pixels of the background; NaN where the truth is not known."""

    epe_median: float = NAN  # end-point error of the dense places [px]
    epe_p95: float = NAN  # [px]
    epe_max: float = NAN  # [px]
    t_x_rmse: float = NAN  # motion of the rows, RMSE over rows [px]
    t_y_rmse: float = NAN  # [px]
    row_max: float = NAN  # the worst row, |(t_x, t_y)| [px]
    rmse: float = NAN  # registered against live [grey levels]
    psnr: float = NAN  # [dB]
    rmse_clean: float = NAN  # registered against live without its noise [grey levels]
    psnr_clean: float = NAN  # [dB]
    rmse_true_path: float = NAN  # what the true path leaves where it is judged [grey levels]
    times_true_path: float = NAN  # what the method leaves there over that
    exposure_error: float = NAN  # |estimated - true| / true

    @property
    def row_rmse(self) -> float:
        """RMSE over rows of the motion in both directions [px]."""
        return math.hypot(self.t_x_rmse, self.t_y_rmse)


@dataclass(frozen=True)
class Score:
    """Everything measured of one method on one case."""

    case: str  # 'planar/07'
    method: str
    changed: bool  # something has changed in this case
    registered: bool
    reason: str  # why not registered, '' otherwise
    seconds: float  # wall clock
    pixels: PixelScores
    objects_25: ObjectScores  # matched at IoU >= 0.25
    objects_50: ObjectScores  # matched at IoU >= 0.5
    registration: RegistrationScores
    statics: tuple[StaticObject, ...] = ()  # layers in view

    @property
    def suite(self) -> str:
        """'planar' of 'planar/07'."""
        return self.case.rpartition('/')[0]

    def as_dict(self) -> dict[str, object]:
        """Return all values by name, nested as here."""
        return asdict(self)


def score(outcome: Outcome, case: Case, method: str, truth: TruePrediction | None = None) -> Score:
    """
    Measure what a method says of a case.

    Where nothing is registered, nothing counts as reported or judged, whatever the masks hold.

    Parameters
    ----------
    outcome : Outcome
    case : Case
    method : str
        Name of the method, for the tables.
    truth : TruePrediction, optional
        What the true path gives, where it is known.

    """
    valid = outcome.valid & outcome.registered
    change = outcome.change & valid
    return Score(
        case=case.name,
        method=method,
        changed=case.changed,
        registered=outcome.registered,
        reason=outcome.reason,
        seconds=outcome.seconds,
        pixels=pixel_scores(change, valid, case.label),
        objects_25=object_scores(change, case.label, case.objects, 0.25),
        objects_50=object_scores(change, case.label, case.objects, 0.5),
        registration=registration_scores(outcome, case, truth),
        statics=static_objects(outcome, case, change),
    )


def pixel_scores(change: np.ndarray, valid: np.ndarray, label: np.ndarray) -> PixelScores:
    """
    Compare a change mask with the truth pixel by pixel (Goyette et al. 2012, changedetection.net).

    A pixel that is not valid counts as not changed, never as ignored: not to judge is no way to
    a better score. Without a changed pixel in the truth, recall, FNR, precision, F and IoU are
    NaN; with some, but none reported, precision is 0, as F is.

    Parameters
    ----------
    change, valid : ndarray of shape (M, N), bool
        Reported as changed; judged.
    label : ndarray of shape (M, N), uint8
        255 changed, 0 not; 170 and 85 are ignored.

    """
    counted = ~ignored(label)
    if not counted.any():
        return PixelScores()
    truth, reported = label[counted] == CHANGED, (change & valid)[counted]
    (tn, fp), (fn, tp) = confusion_matrix(truth, reported, labels=[False, True]).tolist()
    positives = tp + fn
    return PixelScores(
        recall=ratio(tp, positives),
        specificity=ratio(tn, tn + fp),
        fpr=ratio(fp, tn + fp),
        fnr=ratio(fn, positives),
        pwc=100 * (fp + fn) / (tp + fp + fn + tn),
        precision=tp / max(tp + fp, 1) if positives else NAN,
        f=2 * tp / (2 * tp + fp + fn) if positives else NAN,
        iou=tp / (tp + fp + fn) if positives else NAN,
        judged=float(valid[counted].mean()),
    )


def object_scores(
    change: np.ndarray, label: np.ndarray, objects: np.ndarray, min_iou: float
) -> ObjectScores:
    """
    Match reported regions with the objects that are there, one to one.

    A region is a connected component of `change` (8 neighbours) without its ignored pixels: what
    a method reports as one is one, also when only the rim between two parts connects them. It
    counts nothing if ignored pixels leave nothing of it, or less than `LEFTOVER` of the frame;
    the same holds for objects. As many pairs as possible are formed, of these the best.

    Parameters
    ----------
    change : ndarray of shape (M, N), bool
        Reported as changed.
    label : ndarray of shape (M, N), uint8
        255 changed, 0 not; 170 and 85 are ignored.
    objects : ndarray of shape (M, N), uint8
        Number of the object a pixel belongs to, 0: none.
    min_iou : float
        Least intersection over union of a pair, pixels, 0..1.

    """
    ignore = ignored(label)
    regions, region_count = _in_view(components(change, connectivity=2), ignore)
    things, thing_count = _in_view(objects, ignore)
    common = np.bincount(
        (regions * (thing_count + 1) + things).ravel(),
        minlength=(region_count + 1) * (thing_count + 1),
    ).reshape(region_count + 1, thing_count + 1)
    union = common.sum(axis=1, keepdims=True) + common.sum(axis=0, keepdims=True) - common
    iou = common[1:, 1:] / union[1:, 1:]
    fits = iou >= min_iou
    pairs = linear_sum_assignment(np.where(fits, 1 + iou, 0), maximize=True)
    tp = int(fits[pairs].sum())
    near = cv2.dilate(
        np.isin(label, (CHANGED, RIM)).astype(np.uint8),
        np.ones((2 * TOUCH_PX + 1, 2 * TOUCH_PX + 1), np.uint8),
    )
    touching = np.unique(regions[(near > 0) & (regions > 0)]).size
    return ObjectScores(tp, region_count - tp, thing_count - tp, region_count - touching)


def registration_scores(
    outcome: Outcome, case: Case, truth: TruePrediction | None = None
) -> RegistrationScores:
    """
    Measure a registration on pixels that are unchanged, background and in the reference.

    Background is what `motion.layers` calls so, all pixels where no motion is known. The motion of
    a row is the mean over its pixels of (places - true places): t_x, t_y of Rengarajan et al. 2017.
    All values are NaN when nothing is registered.
    """
    found, motion = outcome.registration, case.motion
    if found is None or not outcome.registered:
        return RegistrationScores()
    where = found.inside & (case.label == UNCHANGED)
    if motion is not None:
        where &= motion.layers == 0
    rmse, psnr = _light(found.registered, case.live, where)
    if motion is None:
        return RegistrationScores(rmse=rmse, psnr=psnr)
    clean = (NAN, NAN)
    if motion.clean is not None:
        clean = _light(found.registered, motion.clean, where)
    return RegistrationScores(
        **_place_errors(found.places - motion.places, where),
        rmse=rmse,
        psnr=psnr,
        rmse_clean=clean[0],
        psnr_clean=clean[1],
        **_beside_truth(found, case.live, outcome.valid, truth),
        exposure_error=ratio(
            abs(outcome.exposure_rows - motion.exposure_rows), motion.exposure_rows
        ),
    )


def ignored(label: np.ndarray) -> np.ndarray:
    """Pixels whose truth is not known, (M, N) bool."""
    return np.isin(label, (RIM, OUTSIDE))


def ratio(part: float, whole: float) -> float:
    """Return part / whole, NaN for 0 / 0 and x / 0."""
    return part / whole if whole else NAN


def _in_view(numbers: np.ndarray, ignore: np.ndarray) -> tuple[np.ndarray, int]:
    """Take ignored pixels out of a map of numbered parts; return parts 1..n that remain, and n."""
    names, parts = np.unique(numbers, return_inverse=True)  # 0 is not a part
    parts = parts.reshape(numbers.shape)
    whole = np.bincount(parts.ravel(), minlength=names.size)
    left = np.bincount(parts[~ignore], minlength=names.size)
    keep = (names > 0) & (left > 0) & ((left == whole) | (left >= LEFTOVER * numbers.size))
    renumbered = np.where(keep, np.cumsum(keep), 0)
    return np.where(ignore, 0, renumbered[parts]), int(keep.sum())


def _place_errors(error: np.ndarray, where: np.ndarray) -> dict[str, float]:
    """Summarise errors of places (M, N, 2) [px] over the pixels `where` (M, N) bool."""
    if not where.any():
        return {}
    distance = np.linalg.norm(error[where].astype(np.float64), axis=1)
    median, p95 = np.percentile(distance, [50, 95])
    counts = where.sum(axis=1)
    sums = np.where(where[..., None], error, 0.0).sum(axis=1, dtype=np.float64)
    rows = sums[counts > 0] / counts[counts > 0, None]
    t_x, t_y = np.sqrt((rows**2).mean(axis=0))
    return {
        'epe_median': float(median),
        'epe_p95': float(p95),
        'epe_max': float(distance.max()),
        't_x_rmse': float(t_x),
        't_y_rmse': float(t_y),
        'row_max': float(np.linalg.norm(rows, axis=1).max()),
    }


def _light(registered: np.ndarray, image: np.ndarray, where: np.ndarray) -> tuple[float, float]:
    """RMSE [grey levels] and PSNR [dB] of `registered` against an image, grey or BGR."""
    if not where.any():
        return NAN, NAN
    expected, got = luma(image)[where], registered[where]
    squared = float(mean_squared_error(expected, got))
    if squared == 0:
        return 0.0, math.inf
    return math.sqrt(squared), float(peak_signal_noise_ratio(expected, got, data_range=255))


def _beside_truth(
    found: Registration, live: np.ndarray, valid: np.ndarray, truth: TruePrediction | None
) -> dict[str, float]:
    """Compare a registration with the true path on judged, plain ground."""
    if truth is None:
        return {}
    where = found.inside & valid & truth.where
    rmse, _ = _light(truth.predicted, live, where)
    return {
        'rmse_true_path': rmse,
        'times_true_path': ratio(_light(found.registered, live, where)[0], rmse),
    }
