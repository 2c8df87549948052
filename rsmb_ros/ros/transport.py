"""
Room for big images in Fast DDS.

Its shared-memory segment holds 512 KiB unless a profile says otherwise, and a best-effort image
beyond that is lost without a word. Only the sender needs the profile.
"""

from __future__ import annotations

import shutil
from collections.abc import MutableMapping
from pathlib import Path

PROFILE = Path(__file__).with_name('fastdds_shm.xml')

# The name that Fast DDS 2.14 (Jazzy) reads; later ones read FASTDDS_DEFAULT_PROFILES_FILE.
_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_CHOSEN_BY_VARIABLE = (
    _VARIABLE,
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_BUILTIN_TRANSPORTS',
)
_CHOSEN_BY_FILE = 'DEFAULT_FASTRTPS_PROFILES.xml'  # Fast DDS loads it from the working directory


# One segment of 64 MiB for us and one for a peer; a container's default of 64 MB holds none, and
# then Fast DDS would go without shared memory altogether.
_ROOM_BYTES = 150 * 2**20


def apply_profile(
    environment: MutableMapping[str, str],
    folder: Path,
    shared_memory: Path = Path('/dev/shm'),
) -> str:
    """
    Name the shipped profile in `environment`, before rclpy.init, unless the user chose another.

    Parameters
    ----------
    environment : mapping
        Usually ``os.environ``; changed in place.
    folder : Path
        The working directory.
    shared_memory : Path
        Where segments are made.

    Returns
    -------
    str
        What was decided and why, for the log.

    """
    middleware = environment.get('RMW_IMPLEMENTATION', '')
    if middleware and not middleware.startswith('rmw_fastrtps_'):
        return f'{middleware}, as chosen'
    for name in _CHOSEN_BY_VARIABLE:
        if environment.get(name):
            return f'Fast DDS with {name} = {environment[name]}, as chosen'
    if (folder / _CHOSEN_BY_FILE).exists():
        return f'Fast DDS with {folder / _CHOSEN_BY_FILE}'
    free = shutil.disk_usage(shared_memory).free if shared_memory.exists() else 0
    if free < _ROOM_BYTES:
        return (
            f'plain Fast DDS: {shared_memory} has {free >> 20} MiB free, {_ROOM_BYTES >> 20} '
            'needed; images above 512 KiB may be lost (docker run --shm-size=512m)'
        )
    environment[_VARIABLE] = str(PROFILE)
    return f'Fast DDS with {PROFILE.name}'
