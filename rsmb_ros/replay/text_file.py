"""A text file that holds whole lines at every moment, whatever ends the process."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from rsmb_ros.core.errors import FileProblem


class TextFile:
    """
    Writes the lines of a frame in one call to the operating system.

    Parameters
    ----------
    path : Path
        An existing file is replaced.
    head : str
        What it begins with.

    Raises
    ------
    FileProblem
        If it cannot be written.

    """

    def __init__(self, path: Path, head: str = '') -> None:
        self._path = path
        try:
            self._stream = path.open('wb', buffering=0)
        except OSError as error:
            raise FileProblem(f'{path}: cannot be written: {error.strerror}') from error
        try:
            self.write(head)
        except FileProblem:
            self.close()
            raise

    def write(self, text: str, over: int = 0) -> None:
        """Write `text` over the last `over` bytes of what is there."""
        data = text.encode()
        try:
            if over:
                self._stream.seek(-over, 2)
            if self._stream.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise FileProblem(f'{self._path}: cannot be written: {error.strerror}') from error

    def close(self) -> None:
        """Close the file."""
        self._stream.close()
