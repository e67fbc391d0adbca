"""The HDF5 recording: layout, writer and reader. docs/recording.md is its specification."""

from wineglass.recording.channels import CHANNELS, TAPS, Channel
from wineglass.recording.model import ChannelFormat, Event, RecordingMeta, TapFormat, float_format, fraction_format
from wineglass.recording.reader import Recording, Tap
from wineglass.recording.writer import RecordingWriter

__all__ = [
    "CHANNELS",
    "TAPS",
    "Channel",
    "ChannelFormat",
    "Event",
    "Recording",
    "RecordingMeta",
    "RecordingWriter",
    "Tap",
    "TapFormat",
    "float_format",
    "fraction_format",
]
