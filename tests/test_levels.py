"""Levels of the model through the FMU (more in tests/unit/level_test.cpp).

1. The scene key `model.level` is the start value of the parameter; a wrong name is refused, and so
   is the level for comparison, which the FMU does not carry.
2. The level is chosen before the run: default, massless legs and locked mechanism differ as they
   should; a level that does not fit is refused with one sentence.
3. A host that integrates by itself can choose a level, too: the states are the same.
"""

import xml.etree.ElementTree as ET
import zipfile

import pytest

from extreme_cases.fmi_host import ERROR, Host

DEFAULT = "idss_25t_350t"
NEAR = "initial.approach_time=0.1"
NAMES = ("rigid", "massless_legs", "reduced", "reference")


@pytest.mark.parametrize("level", [1, 3])
def test_the_scene_key_is_the_start_value(runs, level):
    key = () if level == 3 else (f"model.level={NAMES[level - 1]}",)
    with zipfile.ZipFile(runs.fmu(DEFAULT, NEAR, *key)) as fmu:
        root = ET.fromstring(fmu.read("modelDescription.xml"))
    variable = root.find("ModelVariables/ScalarVariable[@name='model.level']")
    assert variable.get("variability") == "fixed"
    assert variable.find("Integer").attrib == {"min": "1", "max": "3", "start": str(level)}


def test_an_unknown_name_is_refused(dockloop):
    status, _, err = dockloop("build", DEFAULT, "--scene", "model.level=stiff")
    assert status != 0
    assert "model.level" in err


def test_the_level_for_comparison_is_refused_when_the_scene_is_built(dockloop):
    status, _, err = dockloop("build", DEFAULT, "--scene", "model.level=reference")
    assert status == 2
    assert "model.level is 4 (reference), a form for comparison" in err, err
    assert "take 1 (rigid), 2 (massless_legs) or 3 (reduced)" in err


def test_levels_differ_as_they_should(runs):
    travel = {}
    for level in (1, 2, 3):
        with Host(runs.fmu(DEFAULT, NEAR)) as host:
            host.choose(model__level=level)
            host.start()
            start = host.value("leg[1].length")
            for _ in range(20):
                host.step(0.01)
            travel[level] = host.value("leg[1].length") - start
            assert host.value("momentum.residual") < 1e-13
    print(travel)
    assert travel[1] == 0.0
    assert abs(travel[3]) > 1e-4
    assert travel[2] == pytest.approx(travel[3], rel=0.2)
    assert travel[2] != travel[3]


@pytest.mark.parametrize("exchange", [False, True], ids=("co-simulation", "model exchange"))
def test_a_level_that_does_not_fit_is_refused_and_others_can_be_taken_then(runs, exchange):
    with Host(runs.comparing_fmu(DEFAULT, NEAR), exchange=exchange) as host:
        host.choose(model__level=4, solver__method=2)
        assert host.status("fmi2ExitInitializationMode") == ERROR
        assert "model.level is 4" in host.last_line
        host.choose(model__level=1, solver__method=1)
        if exchange:
            host.start_exchange()
        else:
            host.start()
