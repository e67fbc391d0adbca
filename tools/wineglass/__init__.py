"""Tools around the Wineglass gyro: simulate, record, calibrate, diagnose."""

import os

__version__ = "0.1.0"

# The matrices here are small: threads of the linear algebra cost more than they bring (a diagnosis of 1 s took 23 s on two busy cores, 2026-11-22).
for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
