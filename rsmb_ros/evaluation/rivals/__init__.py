"""What users reach for today, and the published competitors, in their two-frame versions."""

from __future__ import annotations

from ..methods import Registrar
from . import decision
from .ecc import EccRegistrar
from .features import HomographyRegistrar
from .flow import FlowRegistrar
from .liang import LiangRegistrar
from .mixture import MixtureRegistrar
from .ringaby import RingabyRegistrar
from .rival import Attempt, Rival

__all__ = ['RIVALS', 'Attempt', 'Rival']

_REGISTRARS: tuple[tuple[Registrar, str], ...] = (
    (HomographyRegistrar('orb'), 'OpenCV ORB 2000, cross check, RANSAC homography 3 px'),
    (HomographyRegistrar('sift'), 'OpenCV SIFT, ratio 0.75, RANSAC homography 3 px'),
    (EccRegistrar(), 'OpenCV findTransformECC, homography, started by phase correlation'),
    (FlowRegistrar(), 'ORB homography, then OpenCV DIS flow, medium preset'),
    (MixtureRegistrar(), 'Grundmann et al. ICCP 2012, 10 homographies over the rows, KLT'),
    (LiangRegistrar(), 'Liang et al. TIP 17(8) 2008, blocks of 24 px, cubic Bezier over the rows'),
    (RingabyRegistrar(), 'Ringaby and Forssen IJCV 96 2012, rotation at 8 key rows, KLT'),
    (
        RingabyRegistrar('ringaby-planar', planar=True),
        'Ringaby and Forssen IJCV 96 2012, but t_x, t_y, r_z at 8 key rows, KLT',
    ),
)


def _rivals() -> dict[str, Rival]:
    """Every registrar with both decisions, by name."""
    rivals: dict[str, Rival] = {}
    for registrar, source in _REGISTRARS:
        name = registrar.name
        rivals[name] = Rival(name, f'{source}; Otsu', registrar, decision.otsu)
        tuned = f'{source}; light fitted, sigma 1.5 px, Otsu >= 25 grey levels'
        rivals[f'{name}-tuned'] = Rival(f'{name}-tuned', tuned, registrar, decision.tuned)
    return rivals


RIVALS = _rivals()
