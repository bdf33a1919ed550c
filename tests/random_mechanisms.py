"""Random closed-chain mechanisms and states, as strategies of the library hypothesis.

What is drawn is small and readable: a `Plan` with a trunk of independent joints, a list of branches
or couplings (kind, what it hangs on, what it closes on, a few switches and the seed of its
dimensions) and a list of states. `build` turns it into a document with ``mechanism`` and
``states``, closed by construction: joints are stacked at chosen coordinates, and the cut point of
the closing body is put where the tip of the branch came to lie. A failing plan shrinks to few
branches with all switches off; dimensions come from seeds and stay generic.

Switches of a branch: `lateral` tip next to the leg axis; `turned` arbitrary body axes; `flipped`
joint axes reversed; `zeroed` other zeros of the coordinates, some whole turns away; `extra` an
independent joint within the branch; `massless` links without mass; `closure` stated or not.
With other kinds `extra` means: `twice` lists it as dependent of the copy, which has no row left for
it; `geared_leg` always has it and ties it to a dependent joint of the leg; `gear`, `flywheel` have
another term; `screw` lets a rotor push a new slide.
"""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from hypothesis import strategies as st

from extreme_cases.absolute_kkt import (
    RANK,
    Mechanism,
    axis_rotation,
    find_margin,
    find_pivots,
)

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
CANONICAL = ("R2P1R3", "R2C2R2", "R1R2R3", "R1R2R3_perp", "P1R2R3", "R2R1R3")
OTHER = ("R3P1R2", "R2R2R2", "R1R3R2", "three_random", "four_random")
PLANAR = ("R1R1R1", "R1P1R1", "P1R1R1")
MUTUAL = ("mutual", "mutual_above")  # with the root of the first loop at or above its paths
HINGED = ("R2P1R2", "five_random")  # five joints and a revolute cut
OVERCONSTRAINED = ("planar_hinge", "twice")  # planar with a revolute cut; any branch closed twice
COUPLED = ("gear", "flywheel", "screw", "geared_leg")
KINDS = (*CANONICAL, *OTHER, *PLANAR, *MUTUAL, *HINGED, *OVERCONSTRAINED, *COUPLED)
SHAPES = {  # chains of kinds that are not named after theirs
    "planar_hinge": PLANAR,
    "twice": (*CANONICAL, *OTHER, *PLANAR, *HINGED),
    "geared_leg": ("three_random", "R1R2R3", "R2P1R3", "five_random"),
}
CUTS = {3: "R3", 4: "R2", 5: "R1"}  # by the number of dependent joints
TRUNKS = ("free", "revolute", "prismatic", "carriage_free", "serial_6", "serial_3", "two")

BEST_OF = 8  # dimensions tried per branch
GOOD_MARGIN = 0.15  # a branch with this smallest singular value needs no further try
SMALLEST_MARGIN = 0.05  # of all loops together; below, a mechanism is not used
LARGEST_CONDITION = 1e6  # of the reduced inertia, diagonal scaled to 1
ANGLE, LENGTH = 0.1, 0.05  # displacement of independent coordinates from home


@dataclass(frozen=True)
class Branch:
    """One loop (`mutual`, `twice`: two) or coupling to be hung on what is there already."""

    kind: str
    root: str = "ground"  # ground, trunk, leg
    closing: str = "platform"  # platform, ground, trunk, leg
    pick: int = 0  # which of them
    lateral: bool = False
    turned: bool = False
    flipped: int = 0  # bit i: joint i of the branch; 8: plane axes of a planar branch
    zeroed: bool = False
    extra: bool = False
    massless: bool = False
    closure: str = "absent"  # absent, newton, stated
    listed: bool = True  # the member `dependent` is there
    seed: int = 0


@dataclass(frozen=True)
class State:
    """Random figures of one state."""

    seed: int = 0
    moving: bool = True
    loaded: bool = True
    base_moves: bool = False


@dataclass(frozen=True)
class Plan:
    """What a mechanism is built from."""

    trunk: str
    branches: list[Branch]
    states: list[State]
    floating: bool = False
    gravity: bool = False
    turned: bool = False  # body axes of the trunk
    other_dependents: int = 0  # 0: joints of each branch; else a seed to choose others
    order: int = 0  # seed of the order of the loop table, 0: as built
    newton: bool = False  # the core uses no closed form
    seed: int = 0


@dataclass
class Drawing:
    """Bodies placed so far: poses in the base; `axes` turns drawing axes into body axes.

    `ground` is what everything stands on: the base, or a craft that floats on it. `rng` gives the
    dimensions of what is drawn next.
    """

    rng: np.random.Generator
    ground: str = "base"
    trunk: list[str] = field(default_factory=list)  # names, the platform last

    bodies: list[dict] = field(default_factory=list)
    home_q: list[float] = field(default_factory=list)
    loops: list[dict] = field(default_factory=list)
    couplings: list[dict] = field(default_factory=list)
    pose: dict = field(default_factory=lambda: {"base": (np.eye(3), np.zeros(3))})
    axes: dict = field(default_factory=lambda: {"base": np.eye(3)})
    planes: list = field(default_factory=list)  # bodies that move in one plane, its normal
    features: Counter = field(default_factory=Counter)

    def mark(self):
        """How much there is, to come back to."""
        lists = (self.bodies, self.home_q, self.loops, self.planes, self.couplings)
        return *(len(part) for part in lists), self.features.copy()

    def rewind(self, mark):
        """Forget what came after the mark."""
        for body in self.bodies[mark[0] :]:
            del self.pose[body["name"]], self.axes[body["name"]]
        del self.bodies[mark[0] :], self.home_q[mark[1] :]
        del self.loops[mark[2] :], self.planes[mark[3] :], self.couplings[mark[4] :]
        self.features = mark[5].copy()

    def document(self) -> dict:
        named = {name: getattr(self, name) for name in ("bodies", "loops", "couplings", "home_q")}
        return {name: part for name, part in named.items() if part or name != "couplings"}


def unit(source):
    """Direction of a vector, or a random one of a generator."""
    v = source.normal(size=3) if isinstance(source, np.random.Generator) else source
    return v / np.linalg.norm(v)


def find_plane(normal):
    """Two orthonormal rows across a normal, right-handed about it."""
    x = np.linalg.svd(normal[None])[2][1]
    return np.array([x, np.cross(normal, x)])


def compose(ab, bc):
    """Pose (rotation, origin) of C in A."""
    return ab[0] @ bc[0], ab[1] + ab[0] @ bc[1]


def random_rotation(rng):
    return axis_rotation(unit(rng), np.array(rng.uniform(0.3, 2.8)))


def signed(rng, low, high):
    return rng.choice([-1.0, 1.0]) * rng.uniform(low, high)


def listed(value):
    return np.asarray(value).tolist()


def add_mass(body, rng, scale=1.0):
    """Mass, centre of mass, and the inertia of four points."""
    points = rng.uniform(-0.25, 0.25, size=(4, 3)) * [1.0, 0.7, 0.5]
    points -= points.mean(axis=0)
    mass = scale * rng.uniform(0.5, 2.0)
    inertia = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points) * mass / 4
    body.update(mass=mass, com=listed(rng.uniform(-0.1, 0.1, 3)), inertia=listed(inertia))


def add_body(drawing, name, parent, joint, switches, *, flip=0, mass=1.0):
    """Add a body by a joint (type, axis, position, coordinate, rotation), drawing axes.

    Args:
        drawing: what to add to.
        name: of the body.
        parent: of the body.
        joint: where and how it moves.
        switches: a plan or a branch; `turned` and `zeroed` are used.
        flip: reverse the axis.
        mass: scale of the mass, 0: none.
    """
    kind, axis, position, value, rotation = joint
    rng, up = drawing.rng, drawing.axes[parent]
    own = random_rotation(rng) if switches.turned and kind != "free" else np.eye(3)
    if kind == "free":
        direction, angle = unit(rng), 0.6
        place = rng.uniform(-0.2, 0.2, 3)
        q = [*place, np.cos(angle / 2), *(np.sin(angle / 2) * direction)]
        local = (axis_rotation(direction, np.array(angle)), place)
    else:
        if flip:
            axis, value = -axis, -value
        turns = kind == "revolute"
        if getattr(switches, "zeroed", False):
            shift = signed(rng, 0.05, 1.0) * rng.integers(2)
            if turns:
                rotation = rotation @ axis_rotation(axis, np.array(-shift))
            else:
                position = position - rotation @ axis * shift
            value += shift + 2 * np.pi * turns * rng.integers(-1, 2)
        q = [value]
        axis = own.T @ axis
        local = (axis_rotation(axis, np.array(value * turns)), axis * value * (not turns))
    item = {"type": kind}
    if kind != "free":
        item["axis"] = listed(axis)
    place = (up @ rotation @ own, up @ position)
    if np.any(place[1]):
        item["position"] = listed(place[1])
    if not np.array_equal(place[0], np.eye(3)):
        item["rotation"] = listed(place[0])
    body = {"name": name, "parent": parent, "joint": item}
    if mass:
        add_mass(body, rng, mass)
    drawing.bodies.append(body)
    drawing.home_q += [float(x) for x in q]
    drawing.axes[name] = own.T
    drawing.pose[name] = compose(drawing.pose[parent], compose(place, local))
    return name


def add_trunk(drawing, plan):
    """Independent joints between the ground and the platform, or next to it."""
    rng, ground, trunk = drawing.rng, drawing.ground, drawing.trunk

    def step(name, parent, kind, axis, *, position=ORIGIN, mass=5.0):
        joint = (kind, axis, position, rng.uniform(-0.3, 0.3), np.eye(3))
        trunk.append(add_body(drawing, name, parent, joint, plan, mass=mass))

    at = rng.uniform(-0.3, 0.3, 3) + 0.6 * Z
    if plan.trunk in ("carriage_free", "two"):
        step("carriage", ground, ("prismatic", "revolute")[int(rng.integers(2))], unit(rng))
    if plan.trunk == "carriage_free":
        step("platform", "carriage", "free", Z, position=at)
    elif plan.trunk.startswith("serial"):
        joints = [(kind, axis) for kind in ("prismatic", "revolute") for axis in (X, Y, Z)]
        if plan.trunk == "serial_3":
            joints = [joints[i] for i in sorted(rng.choice(6, 3, replace=False))]
        for i, (kind, axis) in enumerate(joints, 1):
            last = i == len(joints)
            parent, position = (trunk[-1], ORIGIN) if trunk else (ground, at)
            name = "platform" if last else f"stage_{i}"
            step(name, parent, kind, axis, position=position, mass=5.0 * last)
    else:
        kind = "revolute" if plan.trunk == "two" else plan.trunk
        step("platform", ground, kind, unit(rng), position=at)


def make_chain(kind, rng, lateral):
    """Draw the joints of a branch.

    Returns:
        Joints (type, axis, position, coordinate); tip; direction of a universal axis at the tip;
        assembly branch of the closed form, 0 where it has none.
    """
    a, b, c, d = rng.uniform(-0.9, 0.9, size=4)
    l1, l2 = rng.uniform(0.4, 0.9, size=2)
    bent = signed(rng, 0.5, 1.4)
    next_to = lateral * np.array([0.0, signed(rng, 0.02, 0.08), signed(rng, 0.02, 0.08)])
    if kind in PLANAR:
        next_to[2] = 0.0
    elbow = l1 * X + signed(rng, 0.02, 0.1) * Z * (kind in ("R1R2R3", "R1R2R3_perp"))
    round_leg = rng.uniform(-1.0, 1.0)
    across = np.cos(round_leg) * Y + np.sin(round_leg) * Z
    along = unit(X + rng.uniform(-0.5, 0.5) * Y + rng.uniform(-0.5, 0.5) * Z)
    backward = a + np.pi * (b > 0)
    slide = 0.1 * d

    def turn(axis, value, at=ORIGIN):
        return "revolute", axis, at, value

    def push(axis, value=slide):
        return "prismatic", axis, ORIGIN, value

    def anything(value):
        if rng.random() < 0.3:
            return push(unit(rng), 0.3 * value)
        return turn(unit(rng), value, rng.uniform(-0.5, 0.5, 3))

    universal = [turn(Y, a), turn(Z, b)]
    far, near = l1 * X, l2 * X  # of a leg with a slide, and beyond an elbow
    somewhere = rng.uniform(-0.6, 0.6, 3)
    chain, tip = {
        "R2P1R3": ([*universal, push(X)], far),
        "R2C2R2": ([*universal, push(X), turn(X, c)], far),
        "R3P1R2": ([turn(Z, a), turn(Y, b), turn(X, c), push(X)], far),
        "P1R2R3": ([push(along), *universal], far),
        "R1R2R3": ([turn(Z, a), turn(Z, bent, elbow), turn(Y, b)], near),
        "R1R2R3_perp": ([turn(Z, a), turn(Y, b, elbow), turn(Z, bent)], near),
        "R2R1R3": ([*universal, turn(Z, bent, elbow)], near),
        "R2R2R2": ([*universal, turn(Z, bent, elbow), turn(Y, c)], near),
        "R1R3R2": ([turn(Z, a), turn(Z, bent, elbow), turn(Y, b), turn(X, c)], near),
        "three_random": ([turn(unit(rng), a), anything(b), anything(c)], somewhere),
        "four_random": ([turn(unit(rng), a), anything(b), anything(c), anything(d)], somewhere),
        "R2P1R2": ([*universal, push(X), turn(Y, c, far), turn(Z, d)], near),
        "five_random": (
            [turn(unit(rng), a), turn(unit(rng), b), *map(anything, (c, d, round_leg))],
            somewhere,
        ),
        "R1R1R1": ([turn(Z, 3 * a), turn(Z, bent, elbow)], near),
        "R1P1R1": ([turn(Z, 3 * a), push(X)], far),
        "P1R1R1": ([push(X), turn(Z, backward)], far),
    }[kind]
    sign = {
        "R1R2R3": bent,
        "R1R2R3_perp": bent,
        "R2R1R3": bent,
        "R1R1R1": bent,
        "P1R1R1": -np.cos(backward),
        "P1R2R3": -along @ axis_rotation(Y, np.array(a)) @ axis_rotation(Z, np.array(b)) @ X,
    }.get(kind, 0.0)
    return chain, tip + next_to, across, int(np.sign(sign))


def pick_bodies(drawing, branch):
    """Root and closing body of a branch, by their roles."""
    ground, trunk = drawing.ground, drawing.trunk
    legs = [b["name"] for b in drawing.bodies if b["name"] not in {ground, *trunk}]
    groups = {"ground": [ground], "platform": [trunk[-1]], "trunk": trunk, "leg": legs}
    roots, ends = (groups[role] or [ground] for role in (branch.root, branch.closing))
    root = roots[branch.pick % len(roots)]
    ends = [body for body in ends if body != root] or [trunk[-1] if root == ground else ground]
    return root, ends[branch.pick // 7 % len(ends)]


def hang_chain(drawing, branch, name, root, *, chain, frame):
    """Add the bodies of a branch to a root; `frame` is where its first joint is drawn."""
    parent, names = root, []
    for i, (kind, axis, at, value) in enumerate(chain):
        joint = (kind, axis, at, value, np.eye(3))
        if i == 0:
            joint = (kind, axis, frame[1] + frame[0] @ at, value, frame[0])
        last = i + 1 == len(chain)
        heavy = not branch.massless or (last and branch.seed % 2 == 0)
        parent = add_body(
            drawing, f"{name}_{i + 1}", parent, joint, branch,
            flip=branch.flipped >> i & 1, mass=float(heavy),
        )  # fmt: skip
        names.append(parent)
    return names


def insert_extra_joint(chain, kind, rng):
    """Put an independent joint into a chain; returns its place."""
    place = int(rng.integers(1, len(chain)))
    turning = rng.random() < 0.5
    axis, at = unit(rng), rng.uniform(-0.1, 0.1, 3)
    if kind in PLANAR:
        axis, at = (Z if turning else Y), 0.1 * Y
    value = rng.uniform(-0.2, 0.2)
    chain.insert(place, ("revolute" if turning else "prismatic", axis, at, value))
    return place


def close(drawing, root, names, closing, *, dependent, tip, across=X, normal=None, hinge=False):
    """Add the row of the loop table that cuts the last body of `names` from `closing`.

    A planar cut where there is a `normal` of the plane (or a `hinge` along it), else what the
    number of dependent joints asks for; `across` is the axis of a universal or revolute cut.
    """
    rng, terminal = drawing.rng, names[-1]
    axes = drawing.axes[terminal]
    rotation, origin = drawing.pose[terminal]
    at = origin + rotation @ axes @ tip
    if normal is not None:
        kind, across = ("R1", Z) if hinge else ("R1_planar", None)
    else:
        kind = CUTS[len(dependent)]
    cut = {"type": kind, "point_on_terminal": listed(axes @ tip)}
    if kind == "R1_planar":
        cut["plane_axes_in_root"] = listed(find_plane(normal) @ drawing.pose[root][0])
    elif kind != "R3":
        in_base = rotation @ axes @ across
        if kind == "R2":
            on_closing = unit(np.cross(in_base, unit(rng)))
        else:
            on_closing = rng.choice([-1.0, 1.0]) * in_base
        cut["axis_on_terminal"] = listed(axes @ across)
        cut["axis_on_closing"] = listed(drawing.pose[closing][0].T @ on_closing)
    rotation, origin = drawing.pose[closing]
    cut["point_on_closing"] = listed(rotation.T @ (at - origin))
    loop = {"name": names[0].rpartition("_")[0], "root": root, "first": names[0]}
    loop |= {"terminal": terminal, "closing": closing, "cut": cut, "dependent": dependent}
    drawing.loops.append(loop)
    return loop


def find_branch_margin(drawing, mark):
    """Smallest singular value of the rows added after a mark in their own dependents."""
    m = Mechanism(drawing.document())
    G = m.home_jacobian  # noqa: N806
    new = m.loops[mark[2] :]
    rows = [*range(new[0].rows.start if new else m.cut_rows, m.cut_rows)]
    rows += range(m.cut_rows + mark[4], m.rows)
    dep = [m.v_start[b] for loop in new for b in loop.dependent] + m.coupled[mark[4] :]
    values = np.linalg.svd(G[rows][:, dep], compute_uv=False)
    return min(values[values > RANK], default=0.0)  # a joint that is freed adds a zero


def draw_branch(drawing, branch, name):
    """Add one branch."""
    drawing.features[f"kind {branch.kind}"] += 1
    if branch.kind in ("gear", "flywheel", "screw"):
        {"gear": draw_gear, "flywheel": draw_flywheel, "screw": draw_screw}[branch.kind](
            drawing, branch, name
        )
    elif branch.kind in MUTUAL:
        draw_mutual(drawing, branch, name)
    else:
        draw_loop(drawing, branch, name)


def state_closure(loop, branch, sign):
    """Put the closure that a branch asks for into its row of the loop table."""
    if branch.closure == "newton":
        loop["closure"] = "newton"
    elif branch.closure == "stated" and branch.kind in (*CANONICAL, *PLANAR):
        loop["closure"] = branch.kind
        if sign:
            loop["branch"] = sign


def draw_loop(drawing, branch, name):
    """Add a branch of one chain."""
    rng, special = drawing.rng, branch.kind
    shapes = SHAPES.get(special, (special,))
    branch = replace(branch, kind=shapes[branch.pick % len(shapes)])
    if special == "geared_leg":
        branch = replace(branch, extra=True, closure="absent")
    if branch.closure == "stated":  # a name is stated only where the geometry is that of its name
        lateral = branch.lateral and branch.kind in ("R2P1R3", "R1P1R1")
        branch = replace(branch, lateral=lateral, flipped=0, zeroed=False, extra=False)
    chain, tip, across, sign = make_chain(branch.kind, rng, branch.lateral)
    own = list(range(len(chain)))
    if branch.extra:
        place = insert_extra_joint(chain, branch.kind, rng)
        own = [i + (i >= place) for i in own]
    normal = None
    if branch.kind in PLANAR:
        root, closing, frame, normal = draw_plane(drawing, branch, name, len(chain))
    else:
        root, closing = pick_bodies(drawing, branch)
        frame = (random_rotation(rng) if branch.turned else np.eye(3), rng.uniform(-0.5, 0.5, 3))
    names = hang_chain(drawing, branch, name, root, chain=chain, frame=frame)
    if branch.extra and branch.massless:
        add_mass(next(b for b in drawing.bodies if b["name"] == names[place]), rng)
    loop = close(
        drawing, root, names, closing,
        dependent=[names[i] for i in own], tip=tip, across=across, normal=normal,
        hinge=special == "planar_hinge",
    )  # fmt: skip
    if loop["cut"]["type"] == "R1_planar" and branch.flipped & 8:
        loop["cut"]["plane_axes_in_root"].reverse()
    if branch.pick % 3 == 1:
        loop["dependent"].reverse()
    state_closure(loop, branch, sign)
    if not branch.listed and not branch.extra:
        del loop["dependent"]
    note_features(drawing, branch, loop)
    if special == "twice":
        freed = [names[place]] if branch.extra else []  # listed, but no row is left for it
        drawing.loops.append(loop | {"name": f"{name}_again", "dependent": freed})
    if special == "geared_leg":
        add_coupling(drawing, name, names[place], [names[own[branch.pick // 4 % len(own)]]])


def draw_plane(drawing, branch, name, count):
    """Find where a planar branch goes: a new plane with a driver, or the plane of an earlier one.

    Returns:
        Root, closing body, frame of the first joint in drawing axes of the root, normal.
    """
    rng, planes = drawing.rng, drawing.planes
    if branch.root == "leg" and planes:
        bodies, normal = planes[branch.pick % len(planes)]
        root = bodies[branch.pick // 3 % len(bodies)]
        ends = [body for body in bodies if body != root]
        closing = ends[branch.pick // 7 % len(ends)]
    else:
        root, _ = pick_bodies(drawing, branch)
        rotation = random_rotation(rng) if branch.turned else np.eye(3)
        normal = drawing.pose[root][0] @ drawing.axes[root] @ rotation @ Z
        kind, axis = ("revolute", Z) if rng.random() < 0.6 else ("prismatic", X)
        at, value = rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.3, 0.3)
        joint = (kind, axis, at, value, rotation)
        closing = add_body(drawing, f"{name}_driver", root, joint, branch, mass=2.0)
        drawing.features["planar driver"] += 1
        bodies = [root, closing]
    planes.append((bodies + [f"{name}_{i + 1}" for i in range(count)], normal))
    in_base = np.column_stack([*find_plane(normal), normal])
    frame = (drawing.pose[root][0] @ drawing.axes[root]).T @ in_base
    return root, closing, (frame, rng.uniform(-0.5, 0.5, 3)), normal


def draw_mutual(drawing, branch, name):
    """Two chains: the second hangs on a joint that the first determines, and carries its end."""
    rng = drawing.rng
    root, closing = pick_bodies(drawing, branch)
    chain_a, tip_a, *_ = make_chain("three_random", rng, False)
    chain_b, tip_b, *_ = make_chain("three_random", rng, False)
    frame_a, frame_b = ((np.eye(3), rng.uniform(-0.4, 0.4, 3)) for _ in range(2))
    a = hang_chain(drawing, branch, f"{name}a", root, chain=chain_a, frame=frame_a)
    b = hang_chain(drawing, branch, f"{name}b", a[0], chain=chain_b, frame=frame_b)
    first = (root, a) if branch.kind == "mutual_above" else (a[0], a[1:])
    close(drawing, *first, b[1], dependent=[a[1], a[2], b[0]], tip=tip_a)
    close(drawing, a[0], b, closing, dependent=[a[0], b[1], b[2]], tip=tip_b)


def find_joints(drawing):
    """Names of all single joints: all, slides, dependent ones of loops, independent ones."""
    m = Mechanism(drawing.document())
    single = [j for j in range(m.nv) if m.kind[m.body_of_v[j]] != "free"]
    named = {j: m.names[m.body_of_v[j]] for j in single}
    slides = [named[j] for j in single if m.kind[m.body_of_v[j]] == "prismatic"]
    dependent = [named[j] for j in m.dep if j not in m.coupled]
    return [*named.values()], slides, dependent, [named[j] for j in single if j in m.ind]


def add_drive(drawing, branch, name, kind, mass):
    """Add a body on a joint of its own, to be tied to others."""
    rng = drawing.rng
    root, _ = pick_bodies(drawing, branch)
    joint = (kind, unit(rng), rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.3, 0.3), np.eye(3))
    return add_body(drawing, name, root, joint, branch, flip=branch.flipped & 1, mass=mass)


def add_coupling(drawing, name, dependent, joints, ratio=None):
    """Tie a joint to others as they stand, by ratios about 1 unless one is given."""
    rng = drawing.rng
    terms = [{"joint": joint, "ratio": ratio or signed(rng, 0.4, 2.5)} for joint in joints]
    coupling = {"name": f"{name}_gear", "dependent": dependent, "terms": terms}
    drawing.couplings.append(coupling)
    m = Mechanism(drawing.document())
    coupling["offset"] = float(m.ratios[-1] @ m.home_q[m.q_of_v])


def draw_gear(drawing, branch, name):
    """Tie an independent joint to one or two others, as a gear or a differential."""
    while len(independent := find_joints(drawing)[3]) < 2:
        add_drive(drawing, branch, f"{name}_{len(independent)}", "revolute", 1.0)
    first = branch.pick % len(independent)
    dependent, *others = independent[first:] + independent[:first]
    add_coupling(drawing, name, dependent, others[: 1 + branch.extra])


def draw_flywheel(drawing, branch, name):
    """Gear a new flywheel to a dependent joint of a loop, and perhaps to any other too."""
    every, _, dependent, _ = find_joints(drawing)
    wheel = add_drive(drawing, branch, name, "revolute", 0.3)
    joints = dependent or every or [add_drive(drawing, branch, f"{name}_shaft", "prismatic", 1.0)]
    joint = joints[branch.pick % len(joints)]
    others = [other for other in every if other != joint][: int(branch.extra)]
    add_coupling(drawing, name, wheel, [joint, *others])


def draw_screw(drawing, branch, name):
    """Let a slide turn a small rotor by hundreds of radians per metre, or a rotor push a slide."""
    ratio = signed(drawing.rng, 400.0, 700.0)
    slides = find_joints(drawing)[1]
    rotor = add_drive(drawing, branch, f"{name}_rotor", "revolute", 0.005)
    if not slides or branch.extra:
        slides = [add_drive(drawing, branch, f"{name}_nut", "prismatic", 1.0)]
    slide = slides[branch.pick % len(slides)]
    if branch.extra:
        add_coupling(drawing, name, slide, [rotor], 1.0 / ratio)
    else:
        add_coupling(drawing, name, rotor, [slide], ratio)


def note_features(drawing, branch, loop):
    """Count what a branch exercises."""
    *middle, platform = drawing.trunk
    role = dict.fromkeys(middle, "trunk") | {drawing.ground: "ground", platform: "platform"}
    ends = (role.get(loop[end], "leg") for end in ("root", "closing"))
    switches = ("turned", "flipped", "zeroed", "extra", "lateral", "massless")
    drawing.features.update(
        [
            " to ".join(ends),
            f"closure {loop.get('closure', 'absent')}",
            *(switch for switch in switches if getattr(branch, switch)),
            *([] if "dependent" in loop else ["dependent absent"]),
        ]
    )


def find_shared_blocks(m):
    """Number of loops and couplings that another one needs and that need it."""
    paths = [m.moves[loop.terminal] ^ m.moves[loop.closing] for loop in m.loops]
    paths += [row != 0.0 for row in m.ratios]
    dependent = [[m.v_start[body] for body in loop.dependent] for loop in m.loops]
    dependent += [[j] for j in m.coupled]
    needs = np.array([[any(path[own]) for own in dependent] for path in paths], bool)
    needs = needs.reshape(len(paths), len(paths)) & ~np.eye(len(paths), dtype=bool)
    for via in range(len(paths)):
        needs |= needs[:, via, None] & needs[via]
    shared = np.any(needs & needs.T & ~np.eye(len(paths), dtype=bool), axis=1)
    return int(np.sum(shared)), int(np.sum(shared[len(m.loops) :]))


def choose_other_dependents(drawing, seed):
    """Let the loops determine other joints than those of their branches, if they can.

    Joints that no coupling determines are taken greedily by weighted length of what is left of
    their columns; each loop then gets as many as it has equations, all of them on its own paths.
    """
    m = Mechanism(drawing.document())
    if not m.loops or m.redundant:
        return False
    rng = np.random.default_rng(seed)
    G = m.home_jacobian  # noqa: N806
    weight = np.array([m.kind[b] != "free" for b in m.body_of_v]) * rng.uniform(0.2, 1.0, m.nv)
    weight[m.coupled] = 0.0
    chosen = find_pivots(G[: m.cut_rows] * weight)
    if len(chosen) < m.cut_rows:
        return False
    owner: dict[int, int] = {}  # slot (row of G) -> velocity

    def place(j, seen):
        for loop in m.loops:
            if not m.moves[loop.terminal][j] ^ m.moves[loop.closing][j]:
                continue
            for slot in range(loop.rows.start, loop.rows.stop):
                if slot in seen:
                    continue
                seen.add(slot)
                if slot not in owner or place(owner[slot], seen):
                    owner[slot] = j
                    return True
        return False

    if not all(place(j, set()) for j in chosen):
        return False
    if np.linalg.svd(G[:, chosen + m.coupled], compute_uv=False)[-1] < SMALLEST_MARGIN:
        return False
    for loop, item in zip(m.loops, drawing.loops, strict=True):
        slots = range(loop.rows.start, loop.rows.stop)
        item["dependent"] = [m.names[m.body_of_v[owner[slot]]] for slot in slots]
        item.pop("closure", None)
        item.pop("branch", None)
    return True


def make_state(m, state, floating):
    """Figures of one state, dependent coordinates left at home."""
    rng = np.random.default_rng([17, state.seed])
    q = m.home_q.copy()
    for j in m.ind:
        body = m.body_of_v[j]
        if m.kind[body] != "free":
            size = ANGLE if m.kind[body] == "revolute" else LENGTH
            q[m.q_of_v[j]] += size * rng.uniform(-1, 1)
        elif j == m.v_start[body]:
            at = m.q_start[body]
            q[at : at + 3] += LENGTH * rng.uniform(-0.577, 0.577, 3)
            w, x = np.cos(0.5 * ANGLE), np.sin(0.5 * ANGLE) * unit(rng)
            a, b = q[at + 3], q[at + 4 : at + 7].copy()
            q[at + 3] = a * w - b @ x
            q[at + 4 : at + 7] = a * x + w * b + np.cross(b, x)
    item = {"q": listed(q)}
    item["v_independent"] = listed(rng.uniform(-1, 1, len(m.ind)) * state.moving)
    item["tau"] = listed(rng.uniform(-5, 5, m.nv) * state.loaded)
    if state.loaded:
        bodies = rng.choice(np.arange(1, m.count + 1), 3)  # loads on one body add up
        item["external"] = [
            {
                "body": m.names[b],
                "force": listed(rng.uniform(-10, 10, 3)),
                "moment": listed(rng.uniform(-3, 3, 3)),
            }
            for b in bodies
        ]
    if state.base_moves and not floating:
        item["base_motion"] = {
            "angular_velocity": listed(rng.uniform(-0.5, 0.5, 3)),
            "angular_acceleration": listed(rng.uniform(-0.5, 0.5, 3)),
            "linear_acceleration": listed(rng.uniform(-2, 2, 3)),
        }
    return item


def build(plan: Plan):
    """Make a mechanism and states of a plan.

    Returns:
        Document with the members ``mechanism`` and ``states``, and what it exercises (a Counter);
        None where the mechanism is ill-conditioned at home.
    """
    drawing = Drawing(np.random.default_rng([1, plan.seed]))
    if plan.floating:
        joint = ("free", Z, ORIGIN, 0.0, np.eye(3))
        drawing.ground = add_body(drawing, "craft", "base", joint, plan, mass=30.0)
    add_trunk(drawing, plan)
    for number, branch in enumerate(plan.branches, 1):
        mark, tried = drawing.mark(), []
        for attempt in [*range(BEST_OF), None]:
            seed = max(tried)[1] if attempt is None else attempt
            drawing.rng = np.random.default_rng([2, branch.seed, seed])
            draw_branch(drawing, branch, f"leg{number}")
            margin = find_branch_margin(drawing, mark)
            if margin > GOOD_MARGIN or attempt is None:
                break
            tried.append((margin, seed))
            drawing.rewind(mark)
    if plan.other_dependents and choose_other_dependents(drawing, plan.other_dependents):
        drawing.features["other dependents"] += 1
    if plan.order:
        np.random.default_rng([3, plan.order]).shuffle(drawing.loops)
    mechanism = drawing.document() | {"name": "random"}
    if plan.gravity:
        mechanism["gravity"] = listed(np.random.default_rng([4, plan.seed]).uniform(-6, 6, 3))
    m = Mechanism(mechanism)
    margin, condition = find_margin(m)
    if margin < SMALLEST_MARGIN or condition > LARGEST_CONDITION:
        return None
    drawing.features.update([f"trunk {plan.trunk}", f"{len(plan.branches)} branches"])
    together, coupled = find_shared_blocks(m)
    drawing.features.update(
        {"solved together": together, "coupling in a block": coupled, "freed": m.freed,
         "redundant": m.redundant, "overconstrained": m.redundant > 0}
    )  # fmt: skip
    drawing.features.update(s for s in ("floating", "gravity", "order") if getattr(plan, s))
    states = [make_state(m, state, plan.floating) for state in plan.states]
    drawing.features["base motion"] += any("base_motion" in state for state in states)
    for state in states:
        loads = [load["body"] for load in state.get("external", [])]
        drawing.features["loads on one body"] += len(set(loads)) < len(loads)
    return {"mechanism": mechanism, "states": states}, +drawing.features


SEEDS = st.integers(0, 9999)


def branches(kinds):
    """Strategy of one branch of the given kinds."""
    return st.builds(
        Branch,
        kind=st.sampled_from(kinds),
        root=st.sampled_from(["ground", "trunk", "leg"]),
        closing=st.sampled_from(["platform", "ground", "trunk", "leg"]),
        pick=st.integers(0, 99),
        lateral=st.booleans(),
        turned=st.booleans(),
        flipped=st.integers(0, 15),
        zeroed=st.booleans(),
        extra=st.booleans(),
        massless=st.booleans(),
        closure=st.sampled_from(["absent", "stated", "newton"]),
        listed=st.sampled_from([True, True, False]),
        seed=SEEDS,
    )


def plans(kind):
    """Strategy of plans that hold at least one branch of a kind."""
    return st.builds(
        Plan,
        trunk=st.sampled_from(TRUNKS),
        branches=st.integers(0, 5).flatmap(lambda others: st.tuples(
            st.lists(branches(KINDS), min_size=others, max_size=others),
            branches([kind]), st.integers(0, others),
        )).map(lambda drawn: [*drawn[0][: drawn[2]], drawn[1], *drawn[0][drawn[2] :]]),
        states=st.lists(
            st.builds(
                State, seed=SEEDS, moving=st.booleans(), loaded=st.booleans(),
                base_moves=st.booleans(),
            ),
            min_size=1, max_size=3,
        ),
        floating=st.booleans(),
        gravity=st.booleans(),
        turned=st.booleans(),
        other_dependents=st.sampled_from([0, 0, 0, 1, 2]),
        order=st.integers(0, 3),
        newton=st.booleans(),
        seed=SEEDS,
    )  # fmt: skip
