"""All numba code, nothing else: scalars and arrays in, `out` arrays written, no checks."""
