"""What was sealed stays what it was, and what was interrupted goes on."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import blind_sets as sets
import pytest

from wineglass import cli
from wineglass.blind import draw, making, results, running, sealing
from wineglass.blind.choices import PROTOCOLS, TIERS
from wineglass.blind.draw import Wishes
from wineglass.blind.folders import Folders
from wineglass.blind.scheduling import Spread
from wineglass.blind.sheet import Sheet
from wineglass.errors import BadInput

HERE = Path(__file__).resolve().parent


@pytest.fixture
def folders(tmp_path):
    labels = [sets.label(sets.sheet("case_0001", "null")), sets.label(sets.sheet("case_0002", "single", ("ageing", "linear")))]
    return sets.sealed_set(tmp_path / "set", labels)


def answered(folders):
    for name in ("case_0001", "case_0002"):
        sets.answer(folders, name, sets.diagnosis("no_gap", (1.0, "none"), (0.0, "other")))


def change_label(folders, change):
    path = folders.sealed / sealing.LABELS
    content = json.loads(path.read_text())
    change(content["cases"])
    path.write_text(json.dumps(content))


# --- sealing ---------------------------------------------------------------------------------------------------------


def test_what_was_sealed_opens(folders):
    opened = sealing.opened(folders.recordings, folders.sealed)
    assert Sheet.model_validate(opened["case_0002"]["sheet"]).effects[0].id == "ageing"


def test_the_manifest_is_hashes_and_nothing_else(folders):
    text = (folders.recordings / sealing.MANIFEST).read_text()
    assert "ageing" not in text and "single" not in text and "salt" not in text
    assert all(len(digest) == 64 for case in json.loads(text)["cases"].values() for digest in case.values())


def test_a_label_is_not_guessed_from_its_hash_without_the_salt(folders):
    envelope = json.loads((folders.sealed / sealing.LABELS).read_text())["cases"]["case_0001"]
    digest = sealing.manifest(folders.recordings)["case_0001"]["label"]
    assert sealing.label_digest(envelope["salt"], envelope["label"]) == digest != sealing.label_digest("", envelope["label"])


@pytest.mark.parametrize("change, says", [
    (lambda cases: cases["case_0002"]["label"]["sheet"]["effects"][0].update(id="cross_damping"), "case_0002"),
    (lambda cases: cases["case_0001"]["label"]["grade"].update(snr=1.0), "case_0001"),
    (lambda cases: cases["case_0001"].update(salt="0"), "case_0001"),
    (lambda cases: cases.pop("case_0001"), "case_0001"),
    (lambda cases: cases.update(case_0003=cases["case_0001"]), "case_0003"),
    (lambda cases: cases["case_0001"].pop("label"), "case_0001"),
])
def test_a_changed_label_is_refused_by_name(folders, change, says, capsys):
    answered(folders)
    change_label(folders, change)
    assert cli.main(["blind", "score", str(folders.root)]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert not (folders.root / "scores.json").exists()


@pytest.mark.parametrize("action", [["score"], ["run", "--jobs", "0"]])
def test_a_changed_recording_is_refused_by_name(folders, action, capsys):
    answered(folders)
    folders.recording("case_0002").write_bytes(b"another one")
    assert cli.main(["blind", action[0], str(folders.root), *action[1:]]) == 2
    assert "case_0002.h5" in capsys.readouterr().err


def test_an_answer_to_another_recording_is_refused(folders, capsys):
    answered(folders)
    sets.answer(folders, "case_0001", sets.diagnosis("no_gap", (1.0, "none"), (0.0, "other")), recording="0" * 64)
    assert cli.main(["blind", "score", str(folders.root)]) == 2
    assert "case_0001" in capsys.readouterr().err


@pytest.mark.parametrize("damage", [lambda f: (f.sealed / sealing.LABELS).unlink(), lambda f: (f.sealed / sealing.LABELS).write_text("{"),
                                    lambda f: (f.recordings / sealing.MANIFEST).write_text("[]"), lambda f: f.recording("case_0001").unlink()])
def test_what_is_missing_or_damaged_is_one_line(folders, damage, capsys):
    answered(folders)
    damage(folders)
    assert cli.main(["blind", "score", str(folders.root)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_labels_may_be_kept_elsewhere(folders, tmp_path):
    answered(folders)
    folders.sealed.rename(tmp_path / "safe")
    assert cli.main(["--quiet", "blind", "score", str(folders.root), "--labels", str(tmp_path / "safe")]) == 0
    assert (folders.root / "scores.json").is_file() and (folders.root / "scores.html").is_file()


def test_running_needs_no_labels_and_tells_workers_no_path(folders, tmp_path):
    folders.sealed.rename(tmp_path / "safe")
    running.run(folders, "diagnose", Spread(0), work=sets.stub)
    found = results.read(folders.results("diagnose"))
    assert [one["seen"] for one in found.values()] == ["recording 0", "recording 1"]


# --- making and interruption -----------------------------------------------------------------------------------------


@pytest.fixture
def no_allowances(monkeypatch):
    monkeypatch.setattr(making.allowances, "prepare", lambda *arguments: None)


def fake(label, kept):
    assert bool(kept) == bool(label["effects"])
    return b"recording of " + label["name"].encode(), sets.label(Sheet.model_validate(label))


def test_making_goes_on_after_an_interruption(tmp_path, monkeypatch, no_allowances):
    wishes, folders, count = Wishes(6, 3), Folders(tmp_path), []

    def interrupted(label, kept):
        if len(count) == 3:
            raise KeyboardInterrupt
        count.append(label["name"])
        return fake(label, kept)

    monkeypatch.setattr(making, "made", interrupted)
    with pytest.raises(KeyboardInterrupt):
        making.make(wishes, folders, Spread(0))
    assert not (folders.recordings / sealing.MANIFEST).exists()
    kept = folders.recording(count[0]).stat().st_mtime_ns
    monkeypatch.setattr(making, "made", lambda label, kept: (count.append(label["name"]), fake(label, kept))[1])
    seal = making.make(wishes, folders, Spread(0))
    assert len(count) == len(set(count)) == 6 and folders.recording(count[0]).stat().st_mtime_ns == kept
    assert seal == sealing.file_digest(folders.recordings / sealing.MANIFEST) == making.make(wishes, folders, Spread(0))
    assert len(sealing.opened(folders.recordings, folders.sealed)) == 6


def test_an_allowance_is_named_after_all_that_goes_into_it(tmp_path, monkeypatch):
    one = sets.sheet("case_0001", "single", ("ageing", "linear"))
    alike = sets.sheet("case_0002", "single", ("cross_damping", "slope"), factor=3.0, seed=77)
    names = [making.allowances.place(sheet, tmp_path).name for sheet in (one, alike, one.model_copy(update={"loop": "rebalance"}),
             one.model_copy(update={"device": "paper"}), one.model_copy(update={"protocol": "table"}))]
    assert names[0] == names[1] and len(set(names)) == 4
    monkeypatch.setattr(making.allowances, "_program", lambda: "of tomorrow")
    assert making.allowances.place(one, tmp_path).name not in names


def test_allowances_are_made_kind_by_kind_and_kept(tmp_path, monkeypatch):
    seen, sheets = [], [sets.sheet(f"case_{n}", "single", ("ageing", "linear"), loop=loop) for n, loop in enumerate(["open", "rebalance", "open"])]
    monkeypatch.setattr(making.allowances, "measured", lambda label, quiet, fields: seen.append((label["name"], quiet)))
    monkeypatch.setattr(making.allowances, "_gathered", lambda wanted, found: sorted(found))
    monkeypatch.setattr(making.allowances.allowance, "save", lambda found, folder: (folder / "runs").write_text(" ".join(found)))
    missing = making.allowances.missing(sheets, tmp_path)
    assert len(missing) == 2
    making.allowances.prepare(missing, Spread(0))
    assert making.allowances.missing(sheets, tmp_path) == {} and {name for name, _ in seen} == {"metal-fast_full_open", "metal-fast_full_rebalance"}
    runs = (making.allowances.place(sheets[0], tmp_path) / "runs").read_text().split()
    assert len(runs) == len(seen) / 2 > 15 and {"quiet", "noisy"} <= set(runs)


def test_a_folder_holds_one_set(tmp_path, monkeypatch, no_allowances):
    monkeypatch.setattr(making, "made", fake)
    making.make(Wishes(2, 3), Folders(tmp_path), Spread(0))
    with pytest.raises(BadInput, match="another set"):
        making.make(Wishes(2, 4), Folders(tmp_path), Spread(0))


def test_a_killed_run_goes_on_where_it_was(tmp_path):
    labels = [sets.label(sets.sheet(f"case_{i:04d}", "null")) for i in range(1, 9)]
    folders = sets.sealed_set(tmp_path / "set", labels)
    program = ("import sys; from pathlib import Path; import blind_sets; from wineglass.blind import running; "
               "from wineglass.blind.folders import Folders; from wineglass.blind.scheduling import Spread; "
               "running.run(Folders(Path(sys.argv[1])), 'diagnose', Spread(0), work=blind_sets.stub)")
    paths = os.pathsep.join([str(HERE), str(HERE.parents[1] / "tools")])
    child = subprocess.Popen([sys.executable, "-c", program, str(folders.root)], env={**os.environ, "PYTHONPATH": paths, "BLIND_STUB_S": "0.5"})
    target = folders.results("diagnose")
    while child.poll() is None and len(list(target.glob("case_*.json"))) < 3:
        time.sleep(0.02)
    child.send_signal(signal.SIGKILL)
    child.wait()
    before = {path.name: path.stat().st_mtime_ns for path in target.glob("case_*.json")}
    assert 3 <= len(before) < 8
    running.run(folders, "diagnose", Spread(0), work=sets.stub)
    after = {path.name: path.stat().st_mtime_ns for path in target.glob("case_*.json")}
    assert len(after) == 8 and all(after[name] == time_ns for name, time_ns in before.items())


# --- the draw --------------------------------------------------------------------------------------------------------


def test_the_draw_is_repeatable_and_covers_what_it_should():
    sheets = draw.draw(Wishes(400, 17))
    assert sheets == draw.draw(Wishes(400, 17)) != draw.draw(Wishes(400, 18))
    assert {one.tier for one in sheets} == set(TIERS) and {one.protocol for one in sheets} == set(PROTOCOLS)
    assert {one.loop for one in sheets} == {"open", "rebalance"} and len({one.seed for one in sheets}) == 400
    singles = [one for one in sheets if one.tier == "single"]
    assert {one.factor for one in singles} == set(draw.STRENGTHS)
    counts = [sum(one.effects[0].id == id for one in singles) for id in {one.effects[0].id for one in singles}]
    assert len(counts) == 33 and max(counts) - min(counts) <= 2
    assert all(len({effect.id for effect in one.effects}) == len(one.effects) for one in sheets)


@pytest.mark.parametrize("total", [11, 12, 57, 400])
def test_shares_add_up_and_no_tier_is_left_out(total):
    found = draw.apportioned(total, draw.SHARES)
    assert len(found) == total and set(found) == set(draw.SHARES)


def test_an_answer_that_is_being_written_is_none_yet(tmp_path):
    (tmp_path / "case_0001.json").write_text(json.dumps({"case": "case_0001"}), encoding="utf-8")
    (tmp_path / ".case_0002.x1.tmp.json").write_text("", encoding="utf-8")
    assert results.read(tmp_path) == {"case_0001": {"case": "case_0001"}}
