"""Every parameter of the project: its one default, unit, range and meaning."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, cast

from .errors import ConfigError


@dataclass(frozen=True)
class Parameter:
    """One parameter as other parts see it (ROS descriptors, YAML, documentation)."""

    name: str  # dotted, e.g. 'shutter.exposure_rows'
    default: Any
    unit: str  # '-' where it has none
    doc: str
    low: float | None = None
    high: float | None = None
    choices: tuple = ()

    def allowed(self) -> str:
        """Return the allowed values in words, for messages and documentation."""
        if self.choices:
            return 'one of ' + ', '.join(str(choice) for choice in self.choices)
        if isinstance(self.default, bool):
            return 'true or false'
        return f'{self.low:g} to {self.high:g} {self.unit}'.removesuffix(' -')

    def check(self, value: Any) -> Any:
        """
        Return `value` in the type of the default.

        Raises
        ------
        ConfigError
            If the type is wrong or the value is outside the range; nothing is repaired.

        """
        kind = type(self.default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not kind:
            raise ConfigError(
                f'{self.name} = {value!r} is a {type(value).__name__}, '
                f'must be a {kind.__name__}: {self.allowed()}'
            )
        if self.choices:
            ok = value in self.choices
        elif kind in (int, float):
            ok = math.isfinite(value) and self.low <= value <= self.high
        else:
            ok = True
        if not ok:
            raise ConfigError(f'{self.name} = {value!r} is not allowed: must be {self.allowed()}')
        return value


def _number(default: float, unit: str, low: float, high: float, doc: str) -> Any:
    return field(default=default, metadata={'unit': unit, 'low': low, 'high': high, 'doc': doc})


def _choice(default: Any, choices: tuple, doc: str, unit: str = '-') -> Any:
    return field(default=default, metadata={'unit': unit, 'choices': choices, 'doc': doc})


def _switch(default: bool, doc: str) -> Any:
    return field(default=default, metadata={'unit': '-', 'doc': doc})


ESTIMATORS = ('path', 'rows')
SOLVERS = ('active_set', 'osqp')


@dataclass(frozen=True)
class CameraConfig:
    """Intrinsics and tone curve of the live camera."""

    focal_px: float = _number(
        0.0, 'px', 0.0, 1e5, 'focal length; 0 = from camera_info, else 0.9 x image width'
    )
    gamma: float = _number(
        2.2,
        '-',
        0.0,
        3.0,
        'display value = light^(1/gamma), 1 or more; 0 = estimated: seconds a frame, 5 of a stream',
    )


@dataclass(frozen=True)
class ShutterConfig:
    """Row timing of the live camera (Eq. 1)."""

    exposure_rows: float = _number(
        0.0, 'rows', 0.0, 5000.0, 'exposure t_e / line delay t_d; 0 = self-calibrate'
    )
    readout: str = _choice('top_down', ('top_down', 'bottom_up'), 'order the rows are read in')


@dataclass(frozen=True)
class RegistrationConfig:
    """Camera path of the live frame relative to the reference (Eq. 6)."""

    estimator: str = _choice(
        'path',
        ESTIMATORS,
        'path: one camera path a frame; rows: each row alone, as the report does',
    )
    solver: str = _choice(
        'active_set', SOLVERS, 'of rows: ours, or OSQP as a slow cross-check (pip install osqp)'
    )
    degrees_of_freedom: int = _choice(
        6, (2, 3, 4, 6), '2: t_x t_y, 3: + r_z, 4: + scale (not rows), 6: + r_x r_y'
    )
    knot_rows: float = _number(
        24.0, 'rows', 4.0, 1000.0, 'distance of the knots of the camera path; less = livelier path'
    )
    refine_rows: bool = _switch(
        True, 'last step: follow rows that shake faster than the knots, where that measures better'
    )
    search_fraction: float = _number(
        0.3, '-', 0.02, 0.6, 'largest offset of the live frame, share of its size'
    )
    min_overlap: float = _number(
        0.25, '-', 0.05, 1.0, 'share of the live frame that must lie in the reference'
    )
    min_agreement: float = _number(
        0.4, '-', 0.0, 1.0, 'share of textured blocks that must match, else not_registered'
    )


@dataclass(frozen=True)
class StreamConfig:
    """What the frames of a stream teach about the next one."""

    hold: bool = _switch(
        False, 'start from the last frame, hold its exposure: faster; false = each frame alone'
    )


@dataclass(frozen=True)
class PhotometricConfig:
    """Difference of light between reference and live frame."""

    vignetting: bool = _switch(True, 'fit the gain as a polynomial over the frame, not one number')
    tones: bool = _switch(True, "match another camera's tone curve, contrast and white balance")


@dataclass(frozen=True)
class ChangeConfig:
    """From residual to regions."""

    threshold_high: float = _number(
        5.0, 'sigma', 1.0, 50.0, 'evidence that starts a region; higher = fewer alarms'
    )
    threshold_low: float = _number(
        2.2, 'sigma', 0.5, 50.0, 'evidence a region grows over; must be below threshold_high'
    )
    min_area: float = _number(
        2.6e-4, 'share of frame', 0.0, 0.5, 'smaller regions are dropped; 2.6e-4 = 80 px at 640x480'
    )
    min_score: float = _number(
        0.35, '-', 0.0, 1.0, 'changes of a lower score are not reported; 0 = all candidates'
    )
    segmentation: str = _choice(
        'evidence',
        ('evidence', 'entropy'),
        'evidence: thresholds as above; entropy: of |residual|, as the report does',
    )
    shadows: str = _choice(
        'report',
        ('report', 'suppress'),
        'what only gets darker or lighter: a change that is shadow_like, or none',
    )
    persistence_seen: int = _number(
        1, 'frames', 1, 100, 'a region is reported when seen in so many of persistence_frames'
    )
    persistence_frames: int = _number(
        1, 'frames', 1, 100, 'last frames that judged its place; 1 = off, each frame alone'
    )


@dataclass(frozen=True)
class LayersConfig:
    """Static objects at other depths than the background (Algorithm 1)."""

    enabled: bool = _switch(True, 'search a depth for each object; false = planar scene, faster')
    depth_min: float = _number(
        0.3, '-', 0.05, 1.0, 'nearest relative depth searched; background = 1'
    )
    depth_max: float = _number(1.5, '-', 1.0, 5.0, 'farthest relative depth searched')


@dataclass(frozen=True)
class WorkerConfig:
    """The thread that does the work."""

    threads: int = _number(2, 'threads', 1, 64, 'threads that share one frame; results are equal')
    deadline_s: float = _number(
        5.0, 's', 1e-3, 3600.0, 'a frame that takes longer is reported; the node goes on'
    )
    max_megapixels: float = _number(
        50.0, 'Mpx', 0.01, 1000.0, 'larger images are refused, compressed ones before decoding'
    )


@dataclass(frozen=True)
class PublishConfig:
    """Outputs over ROS."""

    queue_depth: int = _number(
        5, 'messages', 1, 1000, 'history of each output topic (reliable, volatile)'
    )


@dataclass(frozen=True)
class Config:
    """
    All parameters, grouped by step; values outside their range raise `ConfigError`.

    Change one with ``Config.from_mapping({'shutter': {'exposure_rows': 40.0}})`` or
    ``config.replaced({'shutter.exposure_rows': 40.0})``.
    """

    camera: CameraConfig = field(default_factory=CameraConfig)
    shutter: ShutterConfig = field(default_factory=ShutterConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    stream: StreamConfig = field(default_factory=StreamConfig)
    photometric: PhotometricConfig = field(default_factory=PhotometricConfig)
    change: ChangeConfig = field(default_factory=ChangeConfig)
    layers: LayersConfig = field(default_factory=LayersConfig)
    worker: WorkerConfig = field(default_factory=WorkerConfig)
    publish: PublishConfig = field(default_factory=PublishConfig)

    def __post_init__(self) -> None:
        values = self.flat()
        for parameter in parameters():
            parameter.check(values[parameter.name])
        if 0.0 < self.camera.gamma < 1.0:
            raise ConfigError(
                f'camera.gamma = {self.camera.gamma!r} is not allowed: must be 0 (estimated) or '
                '1 to 3'
            )
        if self.change.threshold_low >= self.change.threshold_high:
            raise ConfigError(
                f'change.threshold_low = {self.change.threshold_low!r} must be below '
                f'change.threshold_high = {self.change.threshold_high!r}'
            )
        if self.change.persistence_seen > self.change.persistence_frames:
            raise ConfigError(
                f'change.persistence_seen = {self.change.persistence_seen!r} must not be above '
                f'change.persistence_frames = {self.change.persistence_frames!r}'
            )
        registration = self.registration
        if registration.estimator == 'rows' and registration.degrees_of_freedom == 4:
            raise ConfigError(
                'registration.degrees_of_freedom = 4 is not for registration.estimator = rows: '
                'must be 2, 3 or 6'
            )

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Config:
        """Build from nested or dotted keys; what is not named keeps its default."""
        return cls().replaced(flatten(mapping))

    def replaced(self, changes: Mapping[str, Any]) -> Config:
        """
        Return a copy with dotted keys changed.

        Raises
        ------
        ConfigError
            If a key is unknown (the nearest known ones are named) or a value is not allowed.

        """
        known = {parameter.name: parameter for parameter in parameters()}
        sections: dict[str, dict[str, Any]] = {}
        for name, value in changes.items():
            if name not in known:
                raise ConfigError(_unknown(name, known))
            section, key = name.split('.')
            sections.setdefault(section, {})[key] = known[name].check(value)
        return dataclasses.replace(
            self,
            **{
                name: dataclasses.replace(getattr(self, name), **values)
                for name, values in sections.items()
            },
        )

    def for_one_frame(self) -> Config:
        """Return a copy without persistence: in a single frame nothing is seen twice."""
        return self.replaced({'change.persistence_seen': 1, 'change.persistence_frames': 1})

    def nested(self) -> dict[str, dict[str, Any]]:
        """Return all values as ``{section: {key: value}}``."""
        return dataclasses.asdict(self)

    def flat(self) -> dict[str, Any]:
        """Return all values as ``{'section.key': value}``."""
        return flatten(self.nested())


def flatten(mapping: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return `mapping` with nested keys joined by dots."""
    flat: dict[str, Any] = {}
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def parameters() -> Iterator[Parameter]:
    """Iterate over every parameter, in the order of the groups."""
    for section in dataclasses.fields(Config):
        for entry in dataclasses.fields(cast(type, section.default_factory)):
            meta = entry.metadata
            yield Parameter(
                name=f'{section.name}.{entry.name}',
                default=entry.default,
                unit=meta['unit'],
                doc=meta['doc'],
                low=meta.get('low'),
                high=meta.get('high'),
                choices=meta.get('choices', ()),
            )


def _unknown(name: str, known: Mapping[str, Parameter]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    hint = f'did you mean {" or ".join(near)}?' if near else f'known: {", ".join(known)}'
    return f'parameter {name!r} is unknown; {hint}'
