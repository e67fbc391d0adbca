"""SigMF export of raw bursts: the data file holds the interleaved codes, the metadata say where each burst begins."""

import hashlib
import json

import numpy as np
import pytest

from wineglass.cli import main
from wineglass.recording import RecordingMeta, RecordingWriter, TapFormat, float_format, fraction_format

NAMES = ("primary_adc_raw", "secondary_adc_raw")


def record(path):
    rng = np.random.default_rng(1)
    blocks = [rng.integers(-(2**15), 2**15, (n, 2)).astype(np.int16) for n in (30, 20)]
    with RecordingWriter(path, RecordingMeta(50_000.0, firmware_version="1.2")) as writer:
        writer.add_tap("raw", TapFormat(50_000.0, {name: fraction_format(16, "i2") for name in NAMES}))
        for block, first in zip(blocks, (100, 7000)):
            writer.append("raw", {name: block[:, i] for i, name in enumerate(NAMES)}, first, state_snapshot=b"s")
        writer.event("fault", "too loud", sample=7005)
        writer.event("mode", "between bursts", sample=500)
    return np.concatenate(blocks)


def test_bursts_become_captures(tmp_path):
    codes = record(tmp_path / "r.h5")
    assert main(["export", str(tmp_path / "r.h5"), "-o", str(tmp_path / "x.sigmf-meta"), "--quiet"]) == 0
    data = (tmp_path / "x.sigmf-data").read_bytes()
    meta = json.loads((tmp_path / "x.sigmf-meta").read_text())
    np.testing.assert_array_equal(np.frombuffer(data, "<i2").reshape(-1, 2), codes)
    assert meta["global"]["core:datatype"] == "ri16_le" and meta["global"]["core:num_channels"] == 2
    assert meta["global"]["core:sha512"] == hashlib.sha512(data).hexdigest()
    assert meta["captures"] == [{"core:sample_start": 0, "core:global_index": 100}, {"core:sample_start": 30, "core:global_index": 7000}]
    assert meta["annotations"] == [{"core:sample_start": 35, "core:label": "fault", "core:comment": "too loud"}]


def test_the_reference_reader_accepts_it(tmp_path):
    sigmf = pytest.importorskip("sigmf")
    codes = record(tmp_path / "r.h5")
    assert main(["export", str(tmp_path / "r.h5"), "-o", str(tmp_path / "x.sigmf-meta"), "--quiet"]) == 0
    read = sigmf.fromfile(str(tmp_path / "x.sigmf-meta"), autoscale=False)
    read.validate()
    np.testing.assert_array_equal(np.asarray(read.read_samples()).reshape(-1, 2), codes)


def test_nothing_raw_to_export(tmp_path, capsys):
    with RecordingWriter(tmp_path / "r.h5", RecordingMeta(1.0)) as writer:
        writer.add_tap("output", TapFormat(1.0, {"rate": float_format()}))
        writer.append("output", {"rate": np.zeros(3)}, 0)
    assert main(["export", str(tmp_path / "r.h5"), "-o", str(tmp_path / "x.sigmf-meta")]) == 2
    assert "no raw burst" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["r.h5"]
