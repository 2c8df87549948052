"""Scores of many cases in a few numbers, for each suite and method."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from .metrics import NAN, ObjectScores, Score, ratio

TIME_BASE = 'ecc'  # run times are also given as multiples of this method's


@dataclass(frozen=True)
class ObjectSummary:
    """Objects of all cases together; NaN where there is nothing to divide by."""

    recall: float  # 0..1
    precision: float  # 0..1
    f1: float  # 0..1

    @classmethod
    def of(cls, scores: Sequence[ObjectScores]) -> ObjectSummary:
        """Divide sums of counts, so that each object weighs the same."""
        tp = sum(score.tp for score in scores)
        fp = sum(score.fp for score in scores)
        fn = sum(score.fn for score in scores)
        return cls(ratio(tp, tp + fn), ratio(tp, tp + fp), ratio(2 * tp, 2 * tp + fp + fn))


@dataclass(frozen=True)
class Summary:
    """
    One method on one suite; NaN where no case has a value.

    Pixel values are means over the cases that have one: recall, precision, F and IoU over all
    changed cases (0 where not registered), the others over all cases. Errors of the registration
    are over the registered cases only and must be read together with `registered`; of each case
    `epe_*` takes the median over its pixels and `row_*` the RMSE over its rows.
    """

    suite: str
    method: str
    cases: int
    changed: int  # cases in which something has changed
    registered: float  # share of the cases, 0..1
    f_mean: float
    f_median: float
    recall: float
    specificity: float
    fpr: float
    fnr: float
    pwc: float  # [%]
    precision: float
    iou: float
    judged: float  # share of the pixels, 0..1
    objects_25: ObjectSummary  # at IoU >= 0.25
    objects_50: ObjectSummary  # at IoU >= 0.5
    false_alarms_unchanged: float  # per unchanged image
    false_alarms_unchanged_max: float  # in the worst one
    false_alarms_changed: float  # per changed image
    t_x_rmse: float  # motion of the rows, median over cases [px]
    t_y_rmse: float  # [px]
    row_median: float  # both directions together, over cases [px]
    row_p90: float  # [px]
    epe_median: float  # over cases [px]
    epe_p90: float  # [px]
    rmse: float  # registered against live, median over cases [grey levels]
    psnr: float  # [dB]
    rmse_clean: float  # against live without its noise [grey levels]
    psnr_clean: float  # [dB]
    times_true_path: float  # RMSE over what the true path gives, median over cases
    times_true_path_p90: float
    exposure_error: float  # relative, median over cases
    depth_error: float  # of relative depths, median over static objects
    seconds: float  # median over cases
    seconds_q1: float  # quartiles
    seconds_q3: float
    times_ecc: float  # `seconds` over those of `ecc` on the same suite

    def as_dict(self) -> dict[str, object]:
        """Return all values by name."""
        return asdict(self)


def summarise(scores: Iterable[Score]) -> list[Summary]:
    """
    Summarise each method on each suite, in the order in which they first appear.

    Parameters
    ----------
    scores : iterable of Score
        Of one run: run times are compared within each suite.

    """
    groups: dict[tuple[str, str], list[Score]] = {}
    for score in scores:
        groups.setdefault((score.suite, score.method), []).append(score)
    base = {
        suite: median(score.seconds for score in group)
        for (suite, method), group in groups.items()
        if method == TIME_BASE
    }
    return [_summary(group, base.get(suite, NAN)) for (suite, _), group in groups.items()]


def worst(scores: Iterable[Score], n: int = 5) -> list[Score]:
    """
    Pick the cases to look at first, worst first.

    Those not registered come first, then the others by what is lost: 1 - F where something has
    changed, a / (a + 1) for a false alarms where nothing has. Cases without any loss are no worst
    ones, so there may be fewer than `n`.

    Parameters
    ----------
    scores : iterable of Score
        Of one method.
    n : int

    """
    bad = [score for score in scores if not score.registered or _loss(score) > 0]
    return sorted(bad, key=lambda score: (score.registered, -_loss(score), score.case))[:n]


def _loss(score: Score) -> float:
    if score.changed:
        return 0.0 if math.isnan(score.pixels.f) else 1 - score.pixels.f
    alarms = score.objects_25.false_alarms
    return alarms / (alarms + 1)


def _summary(scores: Sequence[Score], base_seconds: float) -> Summary:
    pixels = [score.pixels for score in scores]
    found = [score.registration for score in scores]
    alarms = {
        changed: [score.objects_25.false_alarms for score in scores if score.changed == changed]
        for changed in (False, True)
    }
    seconds = [score.seconds for score in scores]
    return Summary(
        suite=scores[0].suite,
        method=scores[0].method,
        cases=len(scores),
        changed=len(alarms[True]),
        registered=mean(score.registered for score in scores),
        f_mean=mean(pixel.f for pixel in pixels),
        f_median=median(pixel.f for pixel in pixels),
        recall=mean(pixel.recall for pixel in pixels),
        specificity=mean(pixel.specificity for pixel in pixels),
        fpr=mean(pixel.fpr for pixel in pixels),
        fnr=mean(pixel.fnr for pixel in pixels),
        pwc=mean(pixel.pwc for pixel in pixels),
        precision=mean(pixel.precision for pixel in pixels),
        iou=mean(pixel.iou for pixel in pixels),
        judged=mean(pixel.judged for pixel in pixels),
        objects_25=ObjectSummary.of([score.objects_25 for score in scores]),
        objects_50=ObjectSummary.of([score.objects_50 for score in scores]),
        false_alarms_unchanged=mean(alarms[False]),
        false_alarms_unchanged_max=float(max(alarms[False], default=NAN)),
        false_alarms_changed=mean(alarms[True]),
        t_x_rmse=median(one.t_x_rmse for one in found),
        t_y_rmse=median(one.t_y_rmse for one in found),
        row_median=median(one.row_rmse for one in found),
        row_p90=percentile((one.row_rmse for one in found), 90),
        epe_median=median(one.epe_median for one in found),
        epe_p90=percentile((one.epe_median for one in found), 90),
        rmse=median(one.rmse for one in found),
        psnr=median(one.psnr for one in found),
        rmse_clean=median(one.rmse_clean for one in found),
        psnr_clean=median(one.psnr_clean for one in found),
        times_true_path=median(one.times_true_path for one in found),
        times_true_path_p90=percentile((one.times_true_path for one in found), 90),
        exposure_error=median(one.exposure_error for one in found),
        depth_error=median(one.error for score in scores for one in score.statics),
        seconds=median(seconds),
        seconds_q1=percentile(seconds, 25),
        seconds_q3=percentile(seconds, 75),
        times_ecc=ratio(median(seconds), base_seconds),
    )


def mean(values: Iterable[float]) -> float:
    """Return the mean of those that are not NaN, NaN if there are none."""
    known = _known(values)
    return float(np.mean(known)) if known else NAN


def median(values: Iterable[float]) -> float:
    """Return the median of those that are not NaN, NaN if there are none."""
    known = _known(values)
    return float(np.median(known)) if known else NAN


def percentile(values: Iterable[float], percent: float) -> float:
    """Return a percentile of those that are not NaN, NaN if there are none."""
    known = _known(values)
    return float(np.percentile(known, percent)) if known else NAN


def _known(values: Iterable[float]) -> list[float]:
    return [value for value in values if not math.isnan(value)]
