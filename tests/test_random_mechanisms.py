"""Random mechanisms of every kind of loop against a dense solution in absolute coordinates.

1. The oracle (`absolute_kkt` of `extreme_cases`) reproduces the three files of another program.
2. For each kind of branch or coupling, mechanisms that hold one of that kind among up to five
   others (`random_mechanisms.py`) are evaluated by ``check --states``: positions, velocities,
   accelerations, forces of cuts and couplings, joint loads, base loads and reduced inertia are
   those of the oracle, all rows are closed by the oracle's own kinematics, and no state that is
   well-conditioned is refused. Forces of overconstrained mechanisms agree up to self-stresses.
3. Every feature of the generator was really exercised.

``DOCKLOOP_EXAMPLES`` sets the mechanisms per kind, ``DOCKLOOP_SEED`` draws others (without it
always the same). A failing mechanism is shrunk by hypothesis and stored in ``build/failures/``; the
message says which command repeats it.
"""

import json
import os
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, seed, settings

from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.paths import BUILD, shown
from extreme_cases.absolute_kkt import (
    Mechanism,
    close_states,
    find_errors,
    find_gap,
    follow_core,
    read_states,
    run_check,
    solve,
)
from random_mechanisms import KINDS, TRUNKS, build, plans

pytestmark = pytest.mark.long  # long property runs

DATA = Path(__file__).parent / "data"
VECTORS = ("hexapod_r2p1r3", "crank_nested", "planar_two_loop")
USUAL_EXAMPLES = 20
EXAMPLES = int(os.environ.get("DOCKLOOP_EXAMPLES", USUAL_EXAMPLES))
SEED = int(os.environ.get("DOCKLOOP_SEED", "0"))
NEAR_SINGULAR = 0.02  # states that come nearer to a singular pose of the loops are not asked for
TOLERANCE = 7e-11  # relative; measured over 5000 mechanisms: 7e-12 (a, loop_force, joint_load)
GAP = 1e-12  # [m]; measured: 2e-15

tally: Counter = Counter()  # features of the mechanisms compared so far, in all tests
worst: dict[str, float] = {}  # largest errors so far


@pytest.mark.parametrize("name", VECTORS)
def test_the_oracle_reproduces_states_of_another_program(name):
    document = json.loads((DATA / f"{name}.json").read_text())
    states = document["states"]
    errors = find_errors(
        solve(Mechanism(document["mechanism"]), states), [state["expected"] for state in states]
    )
    assert len(errors) == 6
    assert max(errors.values()) < 1e-13, errors  # measured: 6e-15


def compare(document: dict, kind: str, newton: bool, file: Path) -> bool:
    """Compare core and oracle on one document; False where no state is well-conditioned."""
    m = Mechanism(document["mechanism"])
    text = json.dumps(document)
    file.write_text(text)
    margin = np.full(1, np.nan)
    try:
        follow_core(m, file)
        q, margin = close_states(m, read_states(m, document["states"])["q"])
        good = margin > NEAR_SINGULAR
        if not np.any(good):
            return False
        states = [state for state, use in zip(document["states"], good, strict=True) if use]
        text = json.dumps(document | {"states": states})
        file.write_text(text)
        results = run_check(file, newton)
        errors = find_errors(results, solve(m, states, q[good])) | {"gap": find_gap(m, results)}
        wrong = [k for k, error in errors.items() if not error < (GAP if k == "gap" else TOLERANCE)]
        assert not wrong, ", ".join(f"{key} {error:.2g}" for key, error in errors.items())
    except (UsageError, DockloopError, AssertionError) as error:
        kept = BUILD / "failures" / f"{kind}.json"
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(text)
        python = "PYTHONPATH=tests .venv/bin/python -m extreme_cases.absolute_kkt"
        repeat = f"{python} {shown(kept)}{' --newton' if newton else ''}"
        raise AssertionError(
            f"{error}\nsmallest singular values {margin}\nrepeat with: {repeat}"
        ) from None
    for key, value in errors.items():
        worst[key] = max(worst.get(key, 0.0), value)
    tally["states"] += len(states)
    tally["states left out"] += int(np.sum(~good))
    return True


@pytest.mark.parametrize("kind", KINDS)
def test_a_random_mechanism_moves_as_in_absolute_coordinates(kind, tmp_path):
    @seed(zlib.crc32(kind.encode()) + SEED)  # else all kinds would draw the same plans
    @settings(
        max_examples=EXAMPLES, derandomize=True, deadline=None, database=None,
        phases=[Phase.generate, Phase.shrink], suppress_health_check=[HealthCheck.too_slow],
    )  # fmt: skip
    @given(plans(kind))
    def property_holds(plan):
        built = build(plan)
        assume(built is not None)
        document, features = built
        assume(compare(document, kind, plan.newton, tmp_path / "random.json"))
        tally.update(features)
        tally["mechanisms"] += 1
        tally["--newton"] += plan.newton

    property_holds()


def test_every_feature_was_exercised():
    if EXAMPLES < USUAL_EXAMPLES or not all(tally[f"kind {kind}"] for kind in KINDS):
        pytest.skip("needs all kinds to have run and passed")
    features = [f"trunk {trunk}" for trunk in TRUNKS]
    roles = ("ground", "trunk", "platform", "leg")
    features += [f"{a} to {b}" for a in roles for b in roles if a != b or a in ("trunk", "leg")]
    features += ["closure absent", "closure newton", "dependent absent", "--newton"]
    features += ["turned", "flipped", "zeroed", "extra", "lateral", "massless"]
    features += ["floating", "gravity", "order", "base motion", "other dependents"]
    features += ["overconstrained", "freed", "coupling in a block", "loads on one body"]
    features += ["solved together", "planar driver", *(f"{n} branches" for n in range(1, 7))]
    print(dict(sorted(tally.items())), worst)
    missing = [feature for feature in features if not tally[feature]]
    assert not missing, (missing, tally)
