"""What is wrong with a message, in words and as a name to count by."""

from rsmb_ros.core.errors import FrameError


class MalformedMessage(FrameError):
    """A message that contradicts itself or that we cannot read; `cause` groups it in counts."""

    def __init__(self, cause: str, text: str) -> None:
        super().__init__(text)
        self.cause = cause
