"""Parts of perception that Numba compiles, from raw frames to contacts. Tests compare each part with a
version in NumPy."""
