"""What is used of rclpy's logger."""

from __future__ import annotations

from typing import Any, Protocol

# For what may be said at every frame. rclpy counts it for each line of code that says something:
# what shares a line silences each other.
LOG_EVERY_S = 5.0


class Log(Protocol):
    """The part of the logger's interface."""

    def info(self, text: str, **options: Any) -> Any:
        """Tell."""

    def warning(self, text: str, **options: Any) -> Any:
        """Warn."""

    def error(self, text: str, **options: Any) -> Any:
        """Complain."""
