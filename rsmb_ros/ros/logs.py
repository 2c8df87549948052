"""What is used of rclpy's logger."""

from __future__ import annotations

from typing import Any, Protocol

LOG_EVERY_S = 5.0  # for what may be said at every frame


class Log(Protocol):
    """The part of the logger's interface."""

    def info(self, text: str, **options: Any) -> Any:
        """Tell."""

    def warning(self, text: str, **options: Any) -> Any:
        """Warn."""

    def error(self, text: str, **options: Any) -> Any:
        """Complain."""
