"""Spectra hold their height exactly, filters fit all of them, and a choice changes the sea alone."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from heave_env.parameters import GRAVITY, SeaState
from heave_env.plant import simulate
from heave_env.scenarios import load, read, to_yaml, with_value
from heave_env.sea import elevation_fit, wave_filter
from heave_env.shaping import LinearFilter, fit_shaping_filter, orthonormal
from heave_env.spectra import (
    bretschneider,
    elevation_spectrum,
    jonswap,
    modal_omega,
    ochi_hubble,
    pierson_moskowitz,
    read_spectrum,
    significant_wave_height,
    spectral_grid,
    torsethaugen,
    torsethaugen_systems,
)
from heave_env.vessel import boom_tip_components, boom_tip_filter, boom_tip_lines, boom_tip_spectrum

OMEGA = np.geomspace(1e-2, 1e3, 400_000)
SEAS = {
    "bretschneider": SeaState(significant_wave_height=3.0, peak_omega=0.8, filter="fitted"),
    "pierson_moskowitz": SeaState(significant_wave_height=3.0, spectrum="pierson_moskowitz", filter="fitted"),
    "jonswap": SeaState(
        significant_wave_height=3.0,
        peak_omega=0.8,
        spectrum="jonswap",
        filter="fitted",
        filter_order=8,
    ),
    "ochi_hubble": SeaState(
        significant_wave_height=3.0,
        peak_omega=0.5,
        spectrum="ochi_hubble",
        shape=3.0,
        second_wave_height=2.0,
        second_peak_omega=1.1,
        second_shape=1.5,
        filter="fitted",
        filter_order=8,
    ),
    "torsethaugen": SeaState(
        significant_wave_height=3.0,
        peak_omega=2.0 * math.pi / 13.0,
        spectrum="torsethaugen",
        filter="fitted",
        filter_order=8,
    ),
}


def moment(density, power: int) -> float:
    return float(np.trapezoid(OMEGA**power * density, OMEGA))


# The forms ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("sea", SEAS.values(), ids=SEAS)
def test_every_form_holds_its_significant_height(sea):
    assert 4.0 * math.sqrt(moment(elevation_spectrum(OMEGA, sea), 0)) == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize("gamma", [1.0, 1.5, 3.3, 7.0, 20.0])
def test_jonswap_is_normalised_for_every_enhancement(gamma):
    density = jonswap(OMEGA, 2.0, 0.7, gamma)
    assert 4.0 * math.sqrt(moment(density, 0)) == pytest.approx(2.0, rel=1e-6)
    assert OMEGA[np.argmax(density)] == pytest.approx(0.7, rel=1e-3)
    # The factor that practice uses, 1 - 0.287 ln γ, is good to 3 % up to 7 (it was fitted to that range).
    if gamma <= 7.0:
        at_peak = jonswap(np.array([0.7]), 2.0, 0.7, gamma) / bretschneider(np.array([0.7]), 2.0, 0.7)
        assert at_peak[0] == pytest.approx(gamma * (1.0 - 0.287 * math.log(gamma)), rel=0.03)


def test_unenhanced_jonswap_is_bretschneider():
    assert jonswap(OMEGA, 2.0, 0.7, 1.0) == pytest.approx(bretschneider(OMEGA, 2.0, 0.7), rel=1e-9)


def test_pierson_moskowitz_has_phillips_tail():
    # S -> α g² ω⁻⁵ with α = 0.0081, whatever the height: the constant that the form is made of.
    for height in (1.0, 8.0):
        tail = pierson_moskowitz(np.array([20.0]), height)[0]
        assert tail * 20.0**5 / GRAVITY**2 == pytest.approx(0.0081, rel=1e-4)


def test_ochi_hubble_of_shape_one_is_bretschneider():
    assert ochi_hubble(OMEGA, ((2.0, 0.7, 1.0),)) == pytest.approx(bretschneider(OMEGA, 2.0, 0.7), rel=1e-9)


def test_ochi_hubble_peaks_twice_and_adds_the_systems_variances():
    density = elevation_spectrum(OMEGA, SEAS["ochi_hubble"])
    higher = (density[1:-1] > density[:-2]) & (density[1:-1] > density[2:]) & (density[1:-1] > 1e-3)
    peaks = OMEGA[1:-1][higher]
    assert peaks == pytest.approx([0.5, 1.1], rel=0.03)  # each tail moves the other's peak a little
    swell = ochi_hubble(OMEGA, ((math.sqrt(5.0), 0.5, 3.0),))
    assert moment(swell, 0) == pytest.approx(5.0 / 16.0, rel=1e-6)


def test_torsethaugen_is_one_system_where_the_sea_is_fully_developed():
    height = 4.0
    period = 6.6 * height ** (1.0 / 3.0)
    primary, secondary = torsethaugen_systems(height, 2.0 * math.pi / period)
    assert primary[0] == pytest.approx(height, rel=1e-12)
    assert secondary[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("period", "dominant"), [(7.0, "wind sea"), (16.0, "swell")])
def test_torsethaugen_peaks_as_published(period, dominant):
    density = torsethaugen(OMEGA, 3.0, 2.0 * math.pi / period)
    primary, secondary = torsethaugen_systems(3.0, 2.0 * math.pi / period)
    assert math.hypot(primary[0], secondary[0]) == pytest.approx(3.0)
    assert (secondary[1] < primary[1]) == (dominant == "wind sea")
    assert OMEGA[np.argmax(density)] == pytest.approx(primary[1], rel=0.01)
    # Published: peak of the primary system G0 A_γ γ e⁻¹ Hs²/(16 ω_p), with G0 = 3.26 and
    # A_γ = (1 + 1.1 ln(γ)^1.19)/γ fitted to 2 %; the other system adds its part there.
    height, peak, gamma = primary
    factor = 3.26 * (1.0 + 1.1 * math.log(gamma) ** 1.19) / gamma * gamma
    published = factor * math.exp(-1.0) * height**2 / (16.0 * peak)
    x = peak / secondary[1]
    published += 3.26 * x**-4 * math.exp(-(x**-4)) * secondary[0] ** 2 / (16.0 * secondary[1])
    assert density.max() == pytest.approx(published, rel=0.03)


# Measured spectra --------------------------------------------------------------------------------


def measured(tmp_path, **given) -> SeaState:
    omega = np.linspace(0.2, 3.0, 57)
    density = jonswap(omega, 2.0, 0.8, 2.0)
    rows = "\n".join(f"{w!r},{s!r}" for w, s in zip(omega.tolist(), density.tolist(), strict=True))
    path = tmp_path / "buoy.csv"
    path.write_text(f"# a buoy\nomega,density\n{rows}\n")
    return SeaState(
        kind="random_phase",
        spectrum="measured",
        spectrum_file=str(path),
        **given,
    )


def test_a_measured_spectrum_is_the_file_s(tmp_path):
    sea = measured(tmp_path)
    assert modal_omega(sea) == pytest.approx(0.8)
    assert elevation_spectrum(np.array([0.8, 0.825, 0.1, 4.0]), sea) == pytest.approx(
        [*np.interp([0.8, 0.825], [0.8, 0.85], jonswap(np.array([0.8, 0.85]), 2.0, 0.8, 2.0)), 0.0, 0.0]
    )
    # Trapezoids of 0.05 rad/s and the cut at 3 rad/s cost 1 %.
    assert significant_wave_height(sea) == pytest.approx(2.0, rel=0.01)
    record = simulate(
        dataclasses.replace(load("thesis_regulator"), sea_state=sea), seeds=range(100), duration=60
    )
    assert 4.0 * record["boom_tip_heave"].std() == pytest.approx(significant_wave_height(sea), rel=0.03)


def test_a_height_rescales_a_measured_spectrum(tmp_path):
    as_it_is, scaled = measured(tmp_path), measured(tmp_path, significant_wave_height=5.0)
    ratio = elevation_spectrum(OMEGA, scaled).sum() / elevation_spectrum(OMEGA, as_it_is).sum()
    assert ratio == pytest.approx((5.0 / significant_wave_height(as_it_is)) ** 2)


def test_a_changed_file_is_read_anew(tmp_path):
    sea = measured(tmp_path)
    scenario = dataclasses.replace(load("thesis_regulator"), sea_state=sea)
    before, fingerprint = significant_wave_height(sea), scenario.fingerprint
    (tmp_path / "buoy.csv").write_text("omega,density\n0.5,1\n0.8,2\n1.5,0\n")
    assert significant_wave_height(sea) != before
    assert dataclasses.replace(scenario).fingerprint != fingerprint


def test_a_spectrum_file_is_looked_up_beside_the_yaml(tmp_path):
    sea = dataclasses.replace(measured(tmp_path), spectrum_file="buoy.csv")
    scenario = dataclasses.replace(load("thesis_regulator"), sea_state=sea)
    (tmp_path / "mine.yaml").write_text(to_yaml(scenario), encoding="utf-8")
    found = read(tmp_path / "mine.yaml")
    assert found.sea_state.spectrum_file == str(tmp_path / "buoy.csv")
    # What counts is what the file holds, not where it lies.
    (tmp_path / "copy.csv").write_bytes((tmp_path / "buoy.csv").read_bytes())
    moved = with_value(found, "sea_state.spectrum_file", str(tmp_path / "copy.csv"))
    assert moved.fingerprint == found.fingerprint


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("omega,power\n1,1\n", "lacks the column 'density'"),
        ("omega,density\n1,1\n2,\n3,1\n", "line 3: density is ''"),
        ("omega,density\n1,1\n2,nan\n3,1\n", "line 3: density is 'nan'"),
        ("omega,density\n1,1\n3,1\n2,1\n", "line 4: omega must increase"),
        ("omega,density\n-1,1\n1,1\n2,1\n", "line 2: omega must increase from zero"),
        ("omega,density\n1,1\n2,-1\n3,1\n", "line 3: density must not be negative"),
        ("omega,density\n1,0\n2,0\n3,0\n", "not all zero"),
        ("omega,density\n1,1\n2,1\n", "give at least 3"),
    ],
)
def test_bad_spectrum_files_are_refused_in_a_sentence(tmp_path, text, complaint):
    path = tmp_path / "spectrum.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint):
        read_spectrum(path)


def test_without_wavespectra_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "wavespectra", None)
    with pytest.raises(
        ValueError, match=r'spectrum_reader \'swan\' needs .* pip install "heave-env\[spectra\]"'
    ):
        read_spectrum(tmp_path / "any.spec", "swan")


FREQUENCIES = np.round(np.linspace(0.03, 0.6, 58), 4)


def per_hertz(height: float, peak_omega: float, enhancement: float) -> np.ndarray:
    """JONSWAP at `FREQUENCIES` [m²/Hz]."""
    return 2.0 * np.pi * jonswap(2.0 * np.pi * FREQUENCIES, height, peak_omega, enhancement)


WRITTEN = ((3.0, 0.7, 3.3), (2.0, 0.9, 2.0))
"""Two records of one file: height, peak and peak enhancement."""


@pytest.mark.parametrize("format", ["json", "swan", "octopus", "ww3"])
def test_wavespectra_reads_what_it_wrote(tmp_path, format):
    pytest.importorskip("wavespectra", reason="the optional extra `spectra` is not installed")
    xarray = pytest.importorskip("xarray")
    direction = np.arange(0.0, 360.0, 15.0)
    spread = np.cos(0.5 * np.radians(direction - 90.0)) ** 20
    spread /= 15.0 * spread.sum()
    density = np.stack([per_hertz(*sea) for sea in WRITTEN])
    data = xarray.DataArray(
        (density[:, :, None] * spread)[:, None],
        dims=["time", "site", "freq", "dir"],
        coords={
            "time": np.array(["2026-01-01T00", "2026-01-01T03"], dtype="datetime64[ns]"),
            "site": [0],
            "freq": FREQUENCIES,
            "dir": direction,
        },
        name="efth",
    ).to_dataset()
    data["lon"], data["lat"] = ("site", [3.0]), ("site", [56.0])
    for name, value in (("wspd", 10.0), ("wdir", 90.0), ("dpt", 50.0)):
        data[name] = (("time", "site"), np.full((2, 1), value))
    path = tmp_path / f"model.{format}"
    getattr(data.spec, f"to_{format}")(str(path))
    for record, sea in enumerate(WRITTEN):
        spectrum = read_spectrum(path, format, record)
        written = jonswap(spectrum.omega, *sea)
        assert spectrum.density == pytest.approx(written, rel=1e-6, abs=3e-4 * written.max())
    with pytest.raises(ValueError, match="spectrum_record must be below 2"):
        read_spectrum(path, format, 2)
    with pytest.raises(ValueError, match="is no reader of wavespectra; known: .*swan"):
        read_spectrum(path, "jason")


def buoy_file(folder: Path, reader: str) -> Path:
    """A file as a buoy's maker or operator lays it out, with the second of `WRITTEN` after the first."""
    if reader == "ndbc_ascii":
        path = folder / "41001w2026.txt"
        lines = ["#YY  MM DD hh mm " + " ".join(f"{f:.4f}" for f in FREQUENCIES)]
        for hour, sea in enumerate(WRITTEN):
            lines.append(f"2026 01 01 {hour:02d} 00 " + " ".join(f"{s:.7f}" for s in per_hertz(*sea)))
    elif reader == "triaxys":
        path = folder / "20260101.NONDIRSPEC"
        lines = [
            "TRIAXYS BUOY DATA REPORT",
            "TYPE = NON-DIRECTIONAL SPECTRUM",
            "DATE = 2026 Jan 01 00:00(UTC)",
            f"NUMBER OF FREQUENCIES = {len(FREQUENCIES)}",
            "INITIAL FREQUENCY (Hz) = 0.030",
            "FREQUENCY SPACING (Hz) = 0.010",
            "RESOLVABLE FREQUENCY RANGE (Hz) = 0.030 TO 0.600",
            "COLUMN 1 = FREQUENCY (Hz)",
            "COLUMN 2 = SPECTRAL DENSITY (M^2/HZ)",
        ]
        lines += [f"{f:.5E} {s:.7E}" for f, s in zip(FREQUENCIES, per_hertz(*WRITTEN[0]), strict=True)]
    else:
        path = folder / "buoy}2026-01-01T00h00.spt"
        density = per_hertz(*WRITTEN[0])
        head = (1, 300, 7.5, f"{density.max():.8g}", 20, 12, 5, 0, 0, 0, 0, 60)
        lines = [str(number) for number in head]
        lines += [
            f"{f:.4f},{s:.8e},90.0,20.0,0.0,3.0"
            for f, s in zip(FREQUENCIES, density / density.max(), strict=True)
        ]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("reader", ["ndbc_ascii", "triaxys", "datawell"])
def test_wavespectra_reads_what_buoys_write(tmp_path, reader):
    pytest.importorskip("wavespectra", reason="the optional extra `spectra` is not installed")
    path = buoy_file(tmp_path, reader)
    for record, sea in enumerate(WRITTEN if reader == "ndbc_ascii" else WRITTEN[:1]):
        spectrum = read_spectrum(path, reader, record)
        written = jonswap(spectrum.omega, *sea)
        assert spectrum.density == pytest.approx(written, rel=1e-5, abs=1e-6 * written.max())


def test_a_measured_sea_moves_the_boom_tip_as_much_as_the_buoy(tmp_path):
    pytest.importorskip("wavespectra", reason="the optional extra `spectra` is not installed")
    path = buoy_file(tmp_path, "ndbc_ascii")
    measured = {"spectrum": "measured", "spectrum_file": str(path), "spectrum_reader": "ndbc_ascii"}
    for kind, given in (("random_phase", {}), ("shaping_filter", {"filter": "fitted", "filter_order": 8})):
        sea = SeaState(kind=kind, significant_wave_height=0.0, **measured, **given)
        scenario = dataclasses.replace(load("thesis_linear"), sea_state=sea, vessel=None)
        record = simulate(scenario, seeds=range(1024), duration=100.0)
        print(f"{kind}: Hs {4.0 * record['boom_tip_heave'].std():.3f} m of 3")
        assert 4.0 * record["boom_tip_heave"].std() == pytest.approx(3.0, rel=0.02)


def test_records_that_are_missing_are_refused_in_a_sentence(tmp_path):
    csv = tmp_path / "spectrum.csv"
    csv.write_text("omega,density\n0.2,999\n0.5,999\n1.0,999\n3.0,999\n")
    with pytest.raises(
        ValueError, match=r"holds a sea of 212 m: take a record that is not marked as missing"
    ):
        read_spectrum(csv)
    pytest.importorskip("wavespectra", reason="the optional extra `spectra` is not installed")
    path = buoy_file(tmp_path, "ndbc_ascii")
    lines = path.read_text().splitlines()
    lines[2] = "2026 01 01 01 00 " + " ".join(["MM"] * len(FREQUENCIES))
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"wavespectra's reader 'ndbc_ascii' cannot read"):
        read_spectrum(path, "ndbc_ascii", 1)


# What contradicts what ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"spectrum": "jonswop"}, r"spectrum must be one of bretschneider"),
        ({"spectrum": "jonswap"}, r"filter 'thesis' contradicts SeaState\.spectrum 'jonswap'"),
        ({"peak_enhancement": 2.0}, r"peak_enhancement 2\.0 contradicts SeaState\.spectrum 'bretschneider'"),
        ({"kind": "random_phase", "spectrum": "jonswap", "peak_enhancement": 0.5}, "at least 1"),
        ({"shape": 2.0}, r"shape 2\.0 contradicts SeaState\.spectrum"),
        ({"second_wave_height": 1.0}, r"second_wave_height 1\.0 contradicts SeaState\.spectrum"),
        ({"kind": "random_phase", "spectrum": "ochi_hubble"}, "second_wave_height must be between zero and"),
        (
            {"kind": "random_phase", "spectrum": "ochi_hubble", "second_wave_height": 3.0},
            "second_wave_height must be between zero and",
        ),
        ({"kind": "random_phase", "spectrum": "ochi_hubble", "shape": 0.4}, "more than 0.5"),
        (
            {"spectrum": "pierson_moskowitz", "peak_omega": 0.7},
            r"peak_omega 0\.7 contradicts SeaState\.spectrum",
        ),
        ({"kind": "random_phase", "spectrum": "measured"}, "spectrum_file must be a file"),
        ({"spectrum_file": "buoy.csv"}, r"spectrum_file 'buoy\.csv' contradicts SeaState\.spectrum"),
        ({"spectrum_reader": "swan"}, r"spectrum_reader 'swan' contradicts SeaState\.spectrum"),
        ({"spectrum_record": 2}, r"spectrum_record 2 contradicts SeaState\.spectrum"),
        ({"filter": "butterworth"}, "filter must be one of thesis, fitted"),
        ({"filter_order": 8}, r"filter_order 8 contradicts SeaState\.filter 'thesis'"),
        ({"filter": "fitted", "filter_order": 5}, "filter_order must be even and at most 16"),
        ({"filter": "fitted", "filter_order": 18}, "filter_order must be even and at most 16"),
        (
            {"kind": "regular", "spectrum": "jonswap"},
            r"spectrum 'jonswap' contradicts SeaState\.kind 'regular'",
        ),
    ],
)
def test_contradictions_name_both_keys(given, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        SeaState(significant_wave_height=2.0, **given)
    assert "\n" not in str(caught.value)


# Fitted filters ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "order"),
    [("bretschneider", 6), ("pierson_moskowitz", 6), ("jonswap", 6), ("ochi_hubble", 8), ("torsethaugen", 6)],
)
def test_a_fitted_filter_is_within_one_per_cent_in_variance_and_peak(name, order):
    sea = SEAS[name]
    errors = elevation_fit(sea, order).errors
    print(f"{name}, order {order}: " + ", ".join(f"{k} {100 * v:.2f} %" for k, v in vars(errors).items()))
    assert abs(errors.variance) < 1e-6
    assert abs(errors.peak) < 0.01
    assert abs(errors.peak_omega) < 0.01
    assert errors.misfit < 0.04
    # Hs exactly, also of what lies beyond the frequencies of the fit.
    fitted = elevation_fit(sea, order).filter
    assert 4.0 * fitted.output_std[0] == pytest.approx(3.0, rel=1e-9)


def test_four_states_do_not_reach_one_per_cent_of_bretschneider_nor_six_of_a_blunt_jonswap():
    assert elevation_fit(SEAS["bretschneider"], 4).errors.peak > 0.02
    blunt = dataclasses.replace(SEAS["jonswap"], peak_enhancement=1.5)
    assert abs(elevation_fit(blunt, 6).errors.peak) > 0.01
    assert abs(elevation_fit(blunt, 8).errors.peak) < 0.01


@pytest.mark.parametrize("order", [2, 4, 6, 8, 10, 12])
def test_a_fitted_filter_is_stable_and_moves_smoothly(order):
    fitted = elevation_fit(SEAS["jonswap"], order).filter
    assert fitted.n_states == order
    assert np.linalg.eigvals(fitted.A).real.max() < -1e-3
    # No noise in the motion itself, so its rate is the derivative: relative degree two.
    assert fitted.C[0] @ fitted.B == pytest.approx(0.0, abs=1e-9 * np.abs(fitted.C[0]).max())
    assert fitted.C[1] == pytest.approx(fitted.C[0] @ fitted.A, abs=1e-7 * np.abs(fitted.C[1]).max())
    assert fitted.covariance == pytest.approx(np.eye(order), abs=1e-6)
    if order > 2:  # a double zero at the origin: the response falls as ω²
        low = np.abs(fitted.response(np.array([1e-4, 1e-3]))[:, 0])
        assert low[1] / low[0] == pytest.approx(100.0, rel=1e-3)


def test_a_rational_spectrum_is_found_again():
    omega = np.linspace(0.002, 12.0, 6000)
    w1, z1, w2, z2 = 0.7, 0.1, 1.2, 0.4
    s = 1j * omega
    H = s**2 / ((s**2 + 2 * z1 * w1 * s + w1**2) * (s**2 + 2 * z2 * w2 * s + w2**2))
    fit = fit_shaping_filter(omega, np.abs(H) ** 2, 4)
    assert fit.poles[0] == pytest.approx((w1, z1), rel=1e-3)
    assert fit.poles[1] == pytest.approx((w2, z2), rel=1e-3)
    assert fit.errors.misfit < 1e-3


def test_fits_are_the_same_every_time_and_scale_with_the_sea():
    omega = spectral_grid(SEAS["jonswap"])
    density = elevation_spectrum(omega, SEAS["jonswap"])
    first, again = (fit_shaping_filter(omega, density, 6) for _ in range(2))
    assert first.poles == again.poles and np.array_equal(first.filter.A, again.filter.A)
    twice = elevation_fit(dataclasses.replace(SEAS["jonswap"], significant_wave_height=6.0), 6)
    assert np.array(twice.poles) == pytest.approx(np.array(elevation_fit(SEAS["jonswap"], 6).poles), rel=1e-6)


@pytest.mark.parametrize(("order", "complaint"), [(3, "even"), (0, "at least 2")])
def test_odd_orders_are_refused(order, complaint):
    with pytest.raises(ValueError, match=complaint):
        fit_shaping_filter(np.linspace(0.1, 1.0, 10), np.ones(10), order)


def test_a_flat_calm_has_no_filter():
    with pytest.raises(ValueError, match="without variance"):
        fit_shaping_filter(np.linspace(0.1, 1.0, 10), np.zeros(10), 4)


def test_uncorrelated_states_change_nothing_but_coordinates():
    thesis = wave_filter(SeaState(significant_wave_height=3.048, peak_omega=0.785))
    turned = orthonormal(thesis)
    omega = np.linspace(0.1, 3.0, 30)
    assert turned.response(omega) == pytest.approx(thesis.response(omega), rel=1e-6)
    assert turned.covariance == pytest.approx(np.eye(6), abs=1e-9)


# What can be foreseen ----------------------------------------------------------------------------


def test_the_thesis_filter_is_absurdly_predictable():
    # tests/reference/SOURCES.md: of the boom tip nobody can know 9.29e-4 at 1 s and 0.107 at 3 s.
    scenario = load("thesis_linear")
    boom_tip = boom_tip_filter(scenario.sea_state, scenario.vessel)
    share = [boom_tip.unpredictable_std(h)[0] / boom_tip.output_std[0] for h in (1.0, 3.0)]
    assert share == pytest.approx([9.29e-4, 0.107], rel=2e-3)


@pytest.mark.parametrize("order", [4, 8])
def test_what_cannot_be_foreseen_is_the_noise_gathered_meanwhile(order):
    fitted = elevation_fit(SEAS["jonswap"], order).filter
    for horizon in (0.3, 2.0, 10.0):
        _, Q = fitted.discretised(horizon)
        gathered = np.sqrt(np.diag(fitted.C @ Q @ fitted.C.T))
        assert fitted.unpredictable_std(horizon) == pytest.approx(gathered, rel=1e-5)
    assert fitted.unpredictable_std(0.0) == pytest.approx([0.0, 0.0])
    # Far ahead nothing is known.
    assert fitted.unpredictable_std(300.0) == pytest.approx(fitted.output_std, rel=1e-3)


def test_a_single_pole_is_foreseen_as_the_textbook_says():
    # x' = -x/T + w: the share that is unknown h ahead is sqrt(1 - exp(-2 h/T)).
    simple = LinearFilter(np.array([[-0.5]]), np.array([[1.0]]), np.array([[1.0]]))
    assert simple.unpredictable_std(0.7)[0] / simple.output_std[0] == pytest.approx(
        math.sqrt(1.0 - math.exp(-0.7)), rel=1e-9
    )


# The sea that runs -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SEAS)
def test_a_running_fitted_sea_has_its_spectrum(name):
    scenario = dataclasses.replace(load("thesis_regulator"), sea_state=SEAS[name])
    record = simulate(scenario, seeds=range(300), duration=20.0)
    heave, rate = record["boom_tip_heave"], record["boom_tip_heave_rate"]
    exact = boom_tip_filter(SEAS[name], None).output_std
    # 300 seas: the standard error of a deviation is 4 % at one instant, less over 20 s.
    assert heave[0].std() == pytest.approx(0.75, rel=0.1)
    assert [heave.std(), rate.std()] == pytest.approx(exact, rel=0.06)
    assert exact[0] == pytest.approx(0.75, rel=1e-9)
    # The rate is that of the heave: over a step of T it moves by the mean of the rates at both ends, but for
    # white acceleration of intensity N in between, which adds a variance of N T³/12.
    fitted = boom_tip_filter(SEAS[name], None)
    white = math.sqrt(math.pi * (fitted.C[1] @ fitted.B).item() ** 2 * 0.1 / 12.0)
    difference = np.diff(heave, axis=0) / 0.1 - 0.5 * (rate[1:] + rate[:-1])
    assert difference.std() == pytest.approx(white, rel=0.05)
    assert white < 0.15 * rate.std()


@pytest.mark.parametrize("name", ["jonswap", "ochi_hubble", "torsethaugen"])
def test_random_phase_bins_hold_equal_shares_of_any_spectrum(name):
    sea = dataclasses.replace(SEAS[name], kind="random_phase", n_components=40)
    components = boom_tip_components(sea, None)
    assert 0.5 * np.sum(components.amplitude**2) == pytest.approx(9.0 / 16.0, rel=1e-3)
    density = elevation_spectrum(OMEGA, sea)
    for i in (1, 10, 20, 37):
        low, high = components.low[i], components.low[i] + components.width[i]
        inside = (low <= OMEGA) & (high > OMEGA)
        share = np.trapezoid(density[inside], OMEGA[inside]) / (9.0 / 16.0)
        # A bin holds some 30 of these frequencies at least.
        assert share == pytest.approx(1.0 / 40.0, rel=0.06)


def test_lines_and_uncontrolled_payload_follow_the_spectrum():
    swell = dataclasses.replace(SEAS["torsethaugen"], kind="random_phase")
    for sea in (swell, SEAS["ochi_hubble"]):
        omega, variance = boom_tip_lines(sea, None)
        # Beyond the lines lies what falls as ω⁻⁴ of the last tenth.
        assert 4.0 * math.sqrt(variance.sum()) == pytest.approx(3.0, rel=2e-3)
        assert variance == pytest.approx(boom_tip_spectrum(omega, sea, None) * (omega[1] - omega[0]))
    linear = dataclasses.replace(load("thesis_linear"), vessel=None)
    a, b = linear.linear_payload.inertia, linear.linear_payload.damping
    response = 1.0 / np.abs(1.0 - a * OMEGA**2 + 1j * b * OMEGA) ** 2
    expected = math.sqrt(moment(elevation_spectrum(OMEGA, swell) * response, 0))
    found = dataclasses.replace(linear, sea_state=swell).uncontrolled_payload_std
    assert found == pytest.approx(expected, rel=1e-3)


def test_defaults_leave_a_scenario_as_it_was():
    # The fingerprint of before spectra and filters could be chosen.
    assert load("thesis_linear").fingerprint == "b16cd15eddd9ed58"
    assert load("sea_state_5").n_filter_states == 8


def test_another_spectrum_changes_the_sea_and_nothing_else():
    before = load("sea_state_5")
    sea = dataclasses.replace(before.sea_state, spectrum="jonswap", filter="fitted", filter_order=8)
    after = dataclasses.replace(before, sea_state=sea)
    assert after.fingerprint != before.fingerprint
    names = ("observation_names", "n_pending", "static_tension", "observed_lags")
    assert all(getattr(after, name) == getattr(before, name) for name in names)
    # Under the same sea, a recorded or calm one, what the spectrum would be has no say: no bit moves.
    calm = [
        dataclasses.replace(s, sea_state=dataclasses.replace(s.sea_state, kind="calm"))
        for s in (before, after)
    ]
    commands = 0.5 * np.sin(np.arange(50))
    one, two = (simulate(s, seeds=[4], duration=5.0, commands=commands) for s in calm)
    assert all(np.array_equal(one[name], two[name]) for name in one)


def test_the_filter_is_a_matter_of_shaping_filter_seas_alone():
    phases = load("thesis_regulator")
    fitted = dataclasses.replace(phases, sea_state=dataclasses.replace(phases.sea_state, filter="fitted"))
    one, two = (simulate(s, seeds=[4], duration=5.0) for s in (phases, fitted))
    assert all(np.array_equal(one[name], two[name]) for name in one)
