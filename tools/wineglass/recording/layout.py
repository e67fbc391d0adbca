"""Names in the HDF5 file. docs/recording.md describes the layout; this file is its only other copy."""

from __future__ import annotations

import numpy as np

FORMAT = "wineglass-recording"
VERSION = 1

# root attributes
FORMAT_ATTRIBUTE = "format"
VERSION_ATTRIBUTE = "format_version"
COUNTER_RATE = "counter_rate_hz"
FIRMWARE_VERSION = "firmware_version"
SOURCE = "source"
CALIBRATION_CRC = "calibration_crc"

# root datasets
DEVICE = "device_toml"
CALIBRATION_JSON = "calibration_json"
CALIBRATION_BLOCK = "calibration_block"
EVENTS = "events"

# group attributes and datasets
SAMPLE_RATE = "sample_rate_hz"
FIRST_SAMPLE = "first_sample"
LOST = "lost"
SNAPSHOT = "state_snapshot"

# channel attributes
UNIT = "unit"
SCALE = "scale"
OFFSET = "offset"

RAW = "raw"
BURST = "burst_{:04d}"
BURST_PREFIX = "burst_"


def event_dtype() -> np.dtype:
    """Row of the events table: common sample counter, kind, value text."""
    import h5py

    text = h5py.string_dtype("utf-8")
    return np.dtype([("sample", np.int64), ("kind", text), ("value", text)])
