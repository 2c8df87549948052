"""What a camera adds to the light: gain, vignetting, defocus, noise, mosaic, tone curve, JPEG."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rsmb_ros.core.photometric import Light, to_display

_FULL = 65535.0 / 255.0  # 16 bit per grey level of linear light
_SHARPENING_SIGMA = 1.0  # px


@dataclass(frozen=True)
class Nuisances:
    """What a camera adds; the defaults add nothing. Light is linear, 255 = white."""

    gain: float = 1.0  # live / reference: auto-exposure
    bias: float = 0.0  # grey levels of linear light: haze, stray light; live only
    vignetting: float = 0.0  # light lost in the corners of the live frame, 0..1
    overexposure: float = 1.0  # both images: what exceeds white / overexposure saturates
    defocus_px: float = 0.0  # standard deviation of the live frame's extra blur [px]
    noise_electrons: float = np.inf  # electrons at full white: Poisson noise; both
    read_noise: float = 0.0  # standard deviation [grey levels of linear light]; both
    mosaic: bool = False  # one colour a pixel (RGGB), demosaiced; colour images, both
    gamma: float = 2.2  # tone curve: display = light^(1/gamma); both
    contrast: float = 0.0  # share of an S-curve in the live picture; below 0 it is flatter
    warmth: float = 0.0  # red is lighter, blue darker by this share in the live picture
    sharpening: float = 0.0  # share of the unsharp mask that is added; both
    jpeg_quality: int = 0  # 1..100, 0: none; both
    distortion: float = 0.0  # radial, left over: places at half width move by this share; both

    @property
    def of_reference(self) -> Nuisances:
        """What the reference has of it."""
        return replace(
            self, gain=1.0, bias=0.0, vignetting=0.0, defocus_px=0.0, contrast=0.0, warmth=0.0
        )

    def as_dict(self) -> dict[str, float | None]:
        """Return all values by name; None for infinitely many electrons, no Poisson noise."""
        return {name: value if np.isfinite(value) else None for name, value in vars(self).items()}

    @property
    def light(self) -> Light:
        """Gain with vignetting, a fall-off with the squared radius, full at a 4:3 corner."""
        gain = self.gain * self.overexposure
        fall = -self.vignetting * gain / (1.0 + 0.75**2)
        return Light(np.array([gain, 0.0, 0.0, fall]), self.bias)


# What an ordinary drone camera adds, where nothing else is said.
USUAL = Nuisances(gain=1.1, vignetting=0.1, noise_electrons=8000, read_noise=0.3, jpeg_quality=90)


def develop(light: np.ndarray, nuisances: Nuisances, rng: np.random.Generator) -> np.ndarray:
    """
    Turn light on the sensor into the image a camera delivers.

    Parameters
    ----------
    light : ndarray of shape (M, N, C), float
        Linear light, 0..255; C is 1 or 3 (BGR).
    nuisances : Nuisances
        In the order of its fields.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    ndarray of shape (M, N) or (M, N, 3), uint8

    """
    image = np.maximum(light, 0.0)
    if nuisances.defocus_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), nuisances.defocus_px).reshape(light.shape)
    field = nuisances.light.gain_field(light.shape[:2])[..., None]
    image = np.maximum(image * field + nuisances.bias, 0.0)
    mosaic = nuisances.mosaic and light.shape[2] == 3
    if mosaic:
        image = _through_filters(image)
    if np.isfinite(nuisances.noise_electrons):
        per_level = nuisances.noise_electrons / 255.0
        image = rng.poisson(image * per_level) / per_level
    if nuisances.read_noise > 0:
        image = image + rng.normal(0.0, nuisances.read_noise, image.shape)
    image = np.clip(image, 0.0, 255.0)
    if mosaic:
        raw = np.rint(image[..., 0] * _FULL).astype(np.uint16)
        image = cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2BGR_EA).astype(float) / _FULL
    display = in_tones(to_display(image, nuisances.gamma), nuisances)
    if nuisances.sharpening > 0:
        soft = cv2.GaussianBlur(display, (0, 0), _SHARPENING_SIGMA).reshape(display.shape)
        display = np.clip(display + nuisances.sharpening * (display - soft), 0, 255)
    out = np.rint(display).astype(np.uint8)
    out = out if light.shape[2] == 3 else out[..., 0]
    return _compressed(out, nuisances.jpeg_quality) if nuisances.jpeg_quality else out


def in_tones(display: np.ndarray, nuisances: Nuisances) -> np.ndarray:
    """Return display values (M, N, C) in the tones that a camera's settings make of them."""
    if nuisances.contrast:
        share = display / 255.0
        curve = 255.0 * share * share * (3.0 - 2.0 * share)
        display = display + nuisances.contrast * (curve - display)
    if nuisances.warmth and display.shape[2] == 3:
        display = display * (1.0 + nuisances.warmth * np.array([-1.0, 0.0, 1.0]))
    return np.clip(display, 0.0, 255.0)


def _through_filters(image: np.ndarray) -> np.ndarray:
    """Keep the one colour of each pixel's filter, RGGB: (M, N, 3) BGR -> (M, N, 1)."""
    raw = image[..., 1].copy()
    raw[::2, ::2] = image[::2, ::2, 2]
    raw[1::2, 1::2] = image[1::2, 1::2, 0]
    return raw[..., None]


def _compressed(image: np.ndarray, quality: int) -> np.ndarray:
    _, code = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.imdecode(code, cv2.IMREAD_UNCHANGED)
