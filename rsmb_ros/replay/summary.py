"""What came out of a replay, in numbers."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame, Recording
from rsmb_ros.core.types import REGISTERED, Result


@dataclass
class Summary:
    """Counts the frames it takes; a `Sink`."""

    source: Path
    topic: str
    frames: int = 0  # that gave a result
    skipped: int = 0  # that could not be read
    resumed: int = 0  # of the frames, those that an earlier replay had written
    damaged: bool = False  # parts of the recording could not be read, see the warnings
    lost: int = 0  # messages in them, as far as that is known
    registered: int = 0
    with_changes: int = 0  # frames
    changes: int = 0  # regions
    seconds: float = 0.0  # wall-clock, from the start to the last frame
    _start: float = field(default_factory=time.monotonic, repr=False)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Count one frame."""
        self.frames += 1
        self.registered += result.status == REGISTERED
        self.with_changes += bool(result.changes)
        self.changes += len(result.changes)
        self.seconds = time.monotonic() - self._start

    def close(self) -> None:
        """Nothing is left to do."""

    def values(self) -> dict[str, str]:
        """Return the numbers by name, for people."""
        hz = self.frames / self.seconds if self.seconds else 0.0
        lost = self._damage()
        kept = f', {self.resumed} kept of an earlier replay' if self.resumed else ''
        return {
            'bag': str(self.source),
            'topic': self.topic,
            'frames': f'{self.frames}, {self.skipped} more could not be read{lost}{kept}',
            'registered': str(self.registered),
            'frames with changes': f'{self.with_changes}, {self.changes} changes in all',
            'speed': f'{hz:.1f} frames/s, outputs included',
        }

    def count_losses(self, recording: Recording) -> None:
        """Take over what `recording` could not read so far."""
        self.skipped = recording.skipped[self.topic]
        self.damaged, self.lost = bool(recording.damage), recording.damage.lost

    def _damage(self) -> str:
        if not self.damaged:
            return ''
        lost = f'at least {self.lost} messages are lost' if self.lost else 'see the warnings'
        return f', the recording is damaged: {lost}'

    def line(self) -> str:
        """Return the numbers in one line."""
        return '; '.join(f'{name}: {value}' for name, value in self.values().items())
