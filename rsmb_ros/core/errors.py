"""The one tree of exceptions; every message says what, where, the value and what is allowed."""


class RsmbError(Exception):
    """Something the caller can mend: bad data, a bad file, a bad setting."""


class ConfigError(RsmbError):
    """A parameter is unknown, has the wrong type or is out of range."""


class FrameError(RsmbError):
    """An image or an image message cannot be understood."""


class FileProblem(RsmbError):
    """A file is missing, is not what it should be or cannot be written."""


class BagError(FileProblem):
    """A bag cannot be read, or does not hold what was asked for."""
