"""Registration and change detection under rolling-shutter motion blur (RSMB)."""

__version__ = '0.1.0'
