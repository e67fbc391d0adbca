"""Tools around the Wineglass gyro: simulate, record, calibrate, diagnose."""

__version__ = "0.1.0"
