"""The result of a fit drives a sweep: ``--from``, ``fitted=``, entries of type ``fit``.

1. cases have the means, deviations and correlations of the fit, within its ranges; what is not
   identified is uniform;
2. command, Python and file give the same cases; a journal keeps the numbers;
3. bad files are one sentence;
4. a boundary has a band.
"""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.sweeps.sampling import make_sweep
from fit_rig import LATER, RANGES, C, K, fit, move, write_rig
from test_cli import assert_refused

NAMES = [K, C, "chaser.inertia[1]"]
DEVIATIONS = np.array([0.01, 0.03, 0.2])  # parts of the ranges
CORRELATION = 0.8
GIVEN = {
    "made_by": "dockloop fit",
    "values": {K: 23e3, C: 9e3, NAMES[2]: 7e4},
    "vary": {K: [1e4, 4e4], C: [2e3, 4e4], NAMES[2]: [5e4, 9e4]},
    "units": {K: "1", C: "1", NAMES[2]: "kg.m2"},
    "covariance": [[1e-4, 2.4e-4, 0.0], [2.4e-4, 9e-4, 0.0], [0.0, 0.0, 1.0 / 12.0]],
    "not_identified": [{"parameters": [NAMES[2]], "sentence": ""}],
}


def write_fit(path, **changes):
    members = {name: v for name, v in {**GIVEN, **changes}.items() if v is not None}
    path.write_text(json.dumps(members))
    return path


def draw(file, **members):
    sweep = {"scene": "absorber_1d", "cases": 4096, **members}
    return np.array(list(make_sweep(sweep, Path("sweep"), fitted=str(file)).cases))


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_cases_have_the_moments_of_the_fit_and_stay_in_its_ranges(tmp_path, sampling):
    cases = draw(write_fit(tmp_path / "fit.json"), sampling=sampling)
    low, high = np.array([GIVEN["vary"][name] for name in NAMES]).T
    assert (cases >= low).all()
    assert (cases <= high).all()
    parts = (cases - low) / (high - low)
    values = np.array([GIVEN["values"][name] for name in NAMES[:2]])
    mean, deviation = parts[:, :2].mean(axis=0), parts[:, :2].std(axis=0)
    assert mean == pytest.approx((values - low[:2]) / (high - low)[:2], abs=2e-3)
    assert deviation == pytest.approx(DEVIATIONS[:2], rel=0.04)
    together = np.corrcoef(parts.T)
    assert together[0, 1] == pytest.approx(CORRELATION, abs=0.03)
    assert abs(together[2, :2]).max() < 0.05
    anywhere = np.sort(parts[:, 2])
    assert np.abs(anywhere - np.linspace(0.0, 1.0, 4096)).max() < 0.03


def test_a_value_at_a_bound_is_drawn_from_one_half_of_the_bell(tmp_path):
    cases = draw(write_fit(tmp_path / "fit.json", values={**GIVEN["values"], K: 1e4}))
    part = (cases[:, 0] - 1e4) / 3e4
    assert part.min() >= 0.0
    assert part.mean() == pytest.approx(0.01 * np.sqrt(2.0 / np.pi), rel=0.01)
    assert part.std() == pytest.approx(0.01 * np.sqrt(1.0 - 2.0 / np.pi), rel=0.02)


def test_a_fit_bands_the_peak_load_of_a_sweep(dockloop, tmp_path, monkeypatch):
    """From the table of a rig to the peaks of other dockings, by command, Python and file."""
    monkeypatch.chdir(tmp_path)
    rig = write_rig(Path("rig.csv"))
    words = [w for name, ends in RANGES.items() for w in ("--vary", name, *map(str, ends))]
    words += ["--starts", "1", "--scene", f"initial.approach_time={LATER['initial.approach_time']}"]
    dockloop("fit", "absorber_1d", rig, *words, "-o", "fit.json", "--no-plots")
    members = 'scene = "absorber_1d"\ncases = 32\noutcomes = ["capture.peak.compression"]\n'
    members += '[set]\n"initial.approach_time" = 0.5\n'
    Path("plain.toml").write_text(members)
    more = ("--engine", "core", "--no-plots", "--csv")
    dockloop("sweep", "plain.toml", "--from", "fit.json", "-o", "a.parquet", *more)
    a = Path("a.csv").read_bytes()
    Path("band.toml").write_text(members + '[[vary]]\ntype = "fit"\nfile = "fit.json"\n')
    dockloop("sweep", "band.toml", "-o", "b.parquet", *more)
    assert Path("b.csv").read_bytes() == a
    table = dl.sweep("plain.toml", fitted="fit.json")
    _, force = move(np.linspace(0.0, 5.0, 10001))
    peaks = table["capture.peak.compression"]
    assert peaks.mean() == pytest.approx(force.max(), rel=2e-3)
    assert 0.0 < peaks.std() < 2e-3 * force.max()
    fitted = json.loads(Path("fit.json").read_text())
    assert table[K].std() == pytest.approx(fitted["deviations"][K], rel=0.15)
    assert table.attrs["units"][K] == "N/m"

    Path("fit.json").unlink()  # a journal has its numbers, a resumed sweep reads the file again
    resumed = dockloop("sweep", "band.toml", "-o", "b.parquet", "--resume", *more)
    assert_refused(resumed, "fit.json")


def test_the_words_of_a_sweep_have_the_numbers_of_its_fit(tmp_path):
    write_fit(tmp_path / "fit.json")
    sweep = {"scene": "absorber_1d", "cases": 8, "vary": [{"type": "fit", "file": "fit.json"}]}
    made = make_sweep(sweep, tmp_path / "sweep.toml")
    (tmp_path / "fit.json").unlink()
    again = make_sweep(tomllib.loads(made.text), tmp_path / "sweep.toml")
    assert list(again.cases) == list(made.cases)
    assert [(q.name, q.unit) for q in again.quantities][2] == (NAMES[2], "kg.m2")


def test_fits_of_python_say_the_same(tmp_path):
    """What is not identified leads its direction in the summary, as the draw needs it."""
    vary = {**RANGES, "chaser.inertia[1]": (5e4, 9e4)}
    found = fit(write_rig(tmp_path / "rig.csv"), vary=vary)
    (tmp_path / "fit.json").write_text(json.dumps(found.summary))
    inertia = np.sort(draw(tmp_path / "fit.json")[:, 2])
    assert np.abs((inertia - 5e4) / 4e4 - np.linspace(0.0, 1.0, 4096)).max() < 0.01


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"made_by": "dockloop run"}, ["was not written by 'dockloop fit'"]),
        ({"covariance": None}, ["plan of tests"]),
        ({"values": None}, ["values", "again"]),
        ({"values": {"friction.coefficient @ a": 1.0}}, ["all tests share", "--vary"]),
        ({"values": {**GIVEN["values"], K: 5e4}}, [K, "50000", "[10000, 40000]"]),
        ({"values": {**GIVEN["values"], K: "much"}}, ["'values'", "finite numbers"]),
        ({"vary": {**GIVEN["vary"], K: [4e4, 1e4]}}, [K, "ascend"]),
        ({"covariance": [[1.0, 0.0], [0.0, 1.0]]}, ["again"]),
        ({"covariance": [[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, ["positive definite"]),
        ({"covariance": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, ["positive definite"]),
        ({"covariance": [[float("nan"), 0, 0], [0, 1, 0], [0, 0, 1]]}, ["'covariance'", "finite"]),
        ({"units": {}}, ["again"]),
    ],
)
def test_bad_fits_are_one_sentence(dockloop, tmp_path, changes, words):
    write_fit(tmp_path / "bad.json", **changes)
    (tmp_path / "s.toml").write_text('scene = "absorber_1d"\n')
    refused = dockloop("sweep", tmp_path / "s.toml", "--from", tmp_path / "bad.json")
    assert_refused(refused, "bad.json", *words)


@pytest.mark.parametrize(
    "changes",
    [{"units": []}, {"names": [3]}, {"units": [3]}, {"uniform": ["foo"]}, {"covariance": 1}],
)
def test_bad_numbers_of_an_entry_are_one_sentence(tmp_path, changes):
    write_fit(tmp_path / "fit.json")
    members = {"scene": "absorber_1d", "cases": 2, "vary": [{"type": "fit", "file": "fit.json"}]}
    made = tomllib.loads(make_sweep(members, tmp_path / "sweep.toml").text)
    made["vary"][0]["numbers"].update(changes)
    with pytest.raises(dl.UsageError, match=next(iter(changes))):
        make_sweep(made, tmp_path / "sweep.toml")


def test_a_sweep_says_how_often_a_fit_is_drawn(dockloop, tmp_path):
    write_fit(tmp_path / "fit.json")
    (tmp_path / "s.toml").write_text('scene = "absorber_1d"\n')
    refused = dockloop("sweep", tmp_path / "s.toml", "--from", tmp_path / "fit.json")
    assert_refused(refused, "s.toml", "cases", "drawn")


def test_files_that_are_no_fit_and_names_that_meet_are_one_sentence(dockloop, tmp_path):
    (tmp_path / "s.toml").write_text(f'scene = "absorber_1d"\ncases = 4\n[set]\n"{K}" = 2e4\n')
    write_fit(tmp_path / "fit.json")
    for file, words in (("none.json", ["none.json"]), ("s.toml", ["s.toml", "JSON"])):
        refused = dockloop("sweep", tmp_path / "s.toml", "--from", tmp_path / file)
        assert_refused(refused, *words)
    refused = dockloop("sweep", tmp_path / "s.toml", "--from", tmp_path / "fit.json")
    assert_refused(refused, "fit.json", K, "decides already")
    table = '[[vary]]\ntype = "fit"\nfile = ""\n'
    (tmp_path / "s.toml").write_text(f'scene = "absorber_1d"\n{table}')
    refused = dockloop("sweep", tmp_path / "s.toml")
    assert_refused(refused, "vary[1].file")


# ------------------------------------------------------------------------------- 4. a boundary


BOX = {"x": ("initial.closing_speed", 0.05, 0.15), "y": ("chaser.mass", 15e3, 35e3)}
LIMIT = 2500.0  # N


def find_peak(speed, mass, stiffness, damping):
    reduced = mass * 350e3 / (mass + 350e3)
    s = 0.5 * damping / reduced
    w = np.sqrt(stiffness / reduced - s**2)
    t = np.linspace(0.0, np.pi / w, 2001)
    depth = speed / w * np.exp(-s * t) * np.sin(w * t)
    rate = speed * np.exp(-s * t) * (np.cos(w * t) - s / w * np.sin(w * t))
    return (stiffness * depth + damping * rate).max()


def test_a_fit_bands_the_boundary_of_an_envelope(dockloop, tmp_path):
    """Shares of draws are those of the closed form, away from each boundary by its tolerance."""
    both = {"values": {K: 23e3, C: 3e3}, "vary": {K: [1e4, 4e4], C: [2e3, 4e4]}}
    both |= {"units": {K: "N/m", C: "N.s/m"}, "not_identified": []}
    both["covariance"] = [[(6e3 / 3e4) ** 2, 0.0], [0.0, (3e2 / 3.8e4) ** 2]]
    file = write_fit(tmp_path / "fit.json", **both)
    words = [w for letter, axis in BOX.items() for w in (f"--{letter}", *map(str, axis))]
    words += ["--criterion", f"capture.peak.compression < {LIMIT}", "--tolerance", "0.02"]
    words += ["--scene", "initial.approach_time=0.1", "--stop", "3", "--check", "0"]
    words += ["--from", file, "--draws", "4", "--json"]
    folder = tmp_path / "made"
    made = dockloop("envelope", "absorber_1d", *words, "-o", folder, "--report")
    (criterion,) = json.loads(made.out)["criteria"]
    band = criterion["band"]
    assert band["draws"] == 4
    assert 0.02 < band["met"]["low"] < criterion["met"] < band["met"]["high"] < 1.0
    assert 0.1 < band["sometimes"] < 0.9
    # Boundaries of the draws hardly cross: all meet where the worst one does, some where any does.
    assert band["always"] == pytest.approx(band["met"]["low"], abs=1e-3)
    some = band["always"] + band["sometimes"]
    assert some == pytest.approx(band["met"]["high"], abs=1e-3)
    assert (folder / "envelope.png").stat().st_size > 10_000
    found = dl.envelope(
        "absorber_1d", **BOX, criteria=f"capture.peak.compression < {LIMIT}", tolerance=0.02,
        overrides={"initial.approach_time": 0.1}, stop=3, checks=0, fitted=file, draws=4,
        output=folder, resume=True,
    )  # fmt: skip
    assert found.summary["time"]["ran"] == 0  # all is in the journals
    assert found.summary["criteria"] == json.loads(made.out)["criteria"]
    table = found.band
    assert len(table) == 33 * 33
    share = table.columns[2]
    drawn = [(draw[K], draw[C]) for draw in found.draws]
    wrong = 0
    for row in table.iloc[::29].itertuples(index=False):
        peaks = [find_peak(row[0], row[1], *numbers) for numbers in drawn]
        sure = [peak < 0.93 * LIMIT for peak in peaks], [peak < 1.07 * LIMIT for peak in peaks]
        wrong += not np.mean(sure[0]) <= row[2] <= np.mean(sure[1])
    assert wrong == 0, share


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--draws", "1"), ["--draws", "2"]),
        (("--seed", "-1"), ["--seed", "0"]),
        (("--set", f"{K}=2e4"), [K, "--from", "decide already"]),
        (("--from", "none.json"), ["none.json"]),
    ],
)
def test_bad_words_of_a_band_are_one_sentence(dockloop, tmp_path, more, words):
    file = write_fit(tmp_path / "fit.json")
    axes = [w for letter, axis in BOX.items() for w in (f"--{letter}", *map(str, axis))]
    words_ = ("envelope", "absorber_1d", *axes, "--criterion", "captured", "--from", file, *more)
    assert_refused(dockloop(*words_), *words)
