"""Mechanisms with published or exact motions, as documents that a scene can use.

Each function returns the content of a mechanism file; ``test_benchmarks.py`` runs them through the
FMU. Joint zeros are chosen so that the coordinates are the ones in which the problem is stated, and
bodies are named as it names them. Massless bodies have no ``mass``; all loops are closed by Newton.
"""

import math

import numpy as np

PLANE = [[1, 0, 0], [0, 1, 0]]
X, Y, Z = np.eye(3).tolist()

# Andrews' squeezing mechanism (Hairer & Wanner, Solving Ordinary Differential Equations II, VII.7;
# CWI/Bari test set, problem "andrews"): points of the base, start angles, spring, torque.
ANDREWS_A, ANDREWS_B, ANDREWS_C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
ANDREWS_HOME = (
    -0.0617138900142764496,
    0.0,
    0.455279819163070380,
    0.222668390165885885,
    0.487364979543842551,
    -0.222668390165885885,
    1.23054744454982119,
)
ANDREWS_STIFFNESS, ANDREWS_FREE_LENGTH, ANDREWS_TORQUE = 4530.0, 0.07785, 0.033


def diagonal(x, y, z):
    """Inertia as rows."""
    return np.diag([float(x), float(y), float(z)]).tolist()


def joint(kind, axis, position=(0, 0, 0)):
    """Joint of a body, joint axes parallel to the parent's at zero coordinate."""
    return {"type": kind, "axis": list(axis), "position": [float(x) for x in position]}


def planar_body(name, parent, position, load=(0.0, (0.0, 0.0), 0.0), axis=Z):
    """Body that turns about z of the plane; `load`: mass, its centre, inertia about that."""
    mass, com, inertia = load
    return {
        "name": name,
        "parent": parent,
        "joint": joint("revolute", axis, (*position, 0)),
        "mass": mass,
        "com": [*com, 0],
        "inertia": diagonal(0, 0, inertia),
    }


def planar_loop(name, branch, closing, dependent, points):
    """Loop of the plane that hangs on the base and is cut at a hinge.

    Args:
        name: of the loop.
        branch: first and terminal body.
        closing: body from which the terminal one is cut.
        dependent: two bodies whose joints the loop determines.
        points: the hinge on the terminal and on the closing body.
    """
    (first, terminal), (tip, closing_point) = branch, points
    return {
        "name": name,
        "root": "base",
        "first": first,
        "terminal": terminal,
        "closing": closing,
        "cut": {
            "type": "R1_planar",
            "point_on_terminal": [*tip, 0],
            "point_on_closing": [*closing_point, 0],
            "plane_axes_in_root": PLANE,
        },
        "dependent": list(dependent),
    }


def find_andrews_spring(gamma):
    """Length of the spring C-D and the angle of the line from C to D, for a position of K3."""
    c, s = math.cos(gamma), math.sin(gamma)
    x = ANDREWS_B[0] + 0.018 * s + 0.02 * c - ANDREWS_C[0]
    y = ANDREWS_B[1] + 0.02 * s - 0.018 * c - ANDREWS_C[1]
    return math.hypot(x, y), math.atan2(y, x)


def andrews(home=ANDREWS_HOME):
    """Seven bodies in a plane, three loops that share point E, one degree of freedom.

    Coordinates in body order: beta (K1), theta (K2), gamma (K3), delta (K5), phi (K4), epsilon
    (K7), Omega (K6), then the arm and the slide of the spring. Frame G is on K6.
    The spring between D on K3 and the point C of the base is a massless arm with a slide, whose
    coordinate is its length.

    Args:
        home: the seven angles (beta, theta, gamma, phi, delta, Omega, epsilon) of the home pose.
    """
    beta, theta, gamma, phi, delta, omega, epsilon = home
    length, direction = find_andrews_spring(gamma)
    on_e = (-0.028, 0.0)  # point E on K2
    return {
        "name": "andrews",
        "bodies": [
            planar_body("K1", "base", (0, 0), (0.04325, (0.00092, 0), 2.194e-6)),
            planar_body("K2", "K1", (0.007, 0), (0.00365, (-0.0115, 0), 4.410e-7)),
            planar_body("K3", "base", ANDREWS_B, (0.02373, (0.01043, -0.01874), 5.255e-6)),
            planar_body("K5", "base", ANDREWS_A, (0.07050, (0.02308, 0.00916), 1.169e-5)),
            planar_body("K4", "K5", (0.04, 0), (0.00706, (0, -(0.02 - 0.01421)), 5.667e-7)),
            planar_body("K7", "base", ANDREWS_A, (0.05498, (0.00449, -0.01228), 1.912e-5)),
            planar_body("K6", "K7", (0, -0.04), (0.00706, (0.02 - 0.01421, 0), 5.667e-7)),
            planar_body("arm", "base", ANDREWS_C),
            {"name": "slide", "parent": "arm", "joint": joint("prismatic", X)},
        ],
        "loops": [
            planar_loop("E3", ("K3", "K3"), "K2", ["K2", "K3"], ((0, -0.035), on_e)),
            planar_loop("E4", ("K5", "K4"), "K2", ["K5", "K4"], ((0, -0.02), on_e)),
            planar_loop("E6", ("K7", "K6"), "K2", ["K7", "K6"], ((0.02, 0), on_e)),
            planar_loop("CD", ("arm", "slide"), "K3", ["arm", "slide"], ((0, 0), (0.02, -0.018))),
        ],
        "forces": [
            {
                "type": "joint_spring_damper",
                "joint": "slide",
                "stiffness": ANDREWS_STIFFNESS,
                "damping": 0,
                "rest": ANDREWS_FREE_LENGTH,
            },
            {
                "type": "joint_spring_damper",
                "joint": "K1",
                "stiffness": 0,
                "damping": 0,
                "preload": ANDREWS_TORQUE,
            },
        ],
        "home_q": [beta, theta, gamma, delta, phi, epsilon, omega, direction, length],
        "capture": {"body": "K6"},
    }


def four_bars(count):
    """Chain of parallelograms of uniform bars, 1 m and 1 kg each, upright at home.

    Uprights stand on the points (i, 0) and turn by their angle from the vertical, towards +x;
    between their tips lie `count` horizontals. Frame G is on the first one, at its left end.
    """
    backwards = [0, 0, -1]
    bar, level_bar = (1.0, (0, 0.5), 1 / 12), (1.0, (0.5, 0), 1 / 12)
    bodies = [planar_body("upright0", "base", (0, 0), bar, backwards)]
    loops = []
    for i in range(1, count + 1):
        horizontal, upright = f"horizontal{i}", f"upright{i}"
        bodies += [
            planar_body(horizontal, f"upright{i - 1}", (0, 1), level_bar, backwards),
            planar_body(upright, "base", (i, 0), bar, backwards),
        ]
        branch = (f"upright{i - 1}", horizontal)
        points = ((1, 0), (0, 1))
        loops.append(planar_loop(f"bar{i}", branch, upright, [horizontal, upright], points))
    return {
        "name": "four_bars",
        "bodies": bodies,
        "loops": loops,
        "capture": {"body": "horizontal1"},
    }


# Bricard's mechanism: hinges P1 to P6 at home, their axes, and for each cut hinge a choice that
# stays regular over the whole swing: the cross axis on the closing body, the independent bar.
BRICARD_POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1], [0, 0, 0]], dtype=float
)
BRICARD_AXES = np.array([Y, Z, X, Y, Z, X])
BRICARD_ACROSS = (Z, X, Z, Z, Y, Y)
BRICARD_INDEPENDENT = ("bar2", "bar1", "bar1", "bar1", "bar3", "bar3")


def find_bricard_home(bar, cut):
    """Home position of the origin of a bar: the hinge on which it hangs; number 0 or 6 is base."""
    if bar in (0, 6):
        return np.zeros(3)
    return BRICARD_POINTS[bar - 1 if bar < cut else bar]


def bricard(cut, kind="R2"):
    """Six hinges, five bars of 1 m and 1 kg: overconstrained, one degree of freedom.

    Bar j leads from hinge j to hinge j + 1; hinges 1 and 6 are on the base. All bars have the axes
    of the base at home. Hinge `cut` is cut: the bars before it hang on hinge 1 one after the other,
    the bars behind it on hinge 6. Signs are such that every odd hinge turns by the angle a and
    every even one by b, whichever is cut. Frame G is on bar 2.

    Args:
        cut: 1 to 6, the hinge that is cut.
        kind: "R2", a universal cut: four of the five equations of a hinge, the fifth follows from
            them; four hinges are dependent. "R1": the hinge as it is, five equations of which one
            is redundant; all five hinges are listed as dependent.
    """

    def name(bar):
        return "base" if bar in (0, 6) else f"bar{bar}"

    def make_bar(bar):
        forwards = bar < cut
        hinge, parent, sign = (bar, bar - 1, 1.0) if forwards else (bar + 1, bar + 1, -1.0)
        start, end = BRICARD_POINTS[bar - 1], BRICARD_POINTS[bar]
        at = find_bricard_home(bar, cut)
        return {
            "name": name(bar),
            "parent": name(parent),
            "joint": joint(
                "revolute",
                sign * BRICARD_AXES[hinge - 1],
                at - find_bricard_home(parent, cut),
            ),
            "mass": 1.0,
            "com": ((start + end) / 2 - at).tolist(),
            "inertia": diagonal(*((0.02 if x else 1.01) / 12 for x in end - start)),
        }

    bars = [*range(1, cut), *range(5, cut - 1, -1)]
    # The terminal body must be one that moves.
    terminal, closing = (cut - 1, cut) if cut > 1 else (1, 0)
    at, axis = BRICARD_POINTS[cut - 1], BRICARD_AXES[cut - 1].tolist()
    independent = BRICARD_INDEPENDENT[cut - 1] if kind == "R2" else None
    return {
        "name": "bricard",
        "bodies": [make_bar(bar) for bar in bars],
        "loops": [
            {
                "name": f"hinge{cut}",
                "root": "base",
                "first": "bar1" if cut > 1 else "bar5",
                "terminal": name(terminal),
                "closing": name(closing),
                "cut": {
                    "type": kind,
                    "point_on_terminal": (at - find_bricard_home(terminal, cut)).tolist(),
                    "point_on_closing": (at - find_bricard_home(closing, cut)).tolist(),
                    "axis_on_terminal": axis,
                    "axis_on_closing": BRICARD_ACROSS[cut - 1] if kind == "R2" else axis,
                },
                "dependent": [name(bar) for bar in bars if name(bar) != independent],
            }
        ],
        "capture": {"body": "bar2"},
    }


def spatial_slider_crank(variant, cut="pin"):
    """Crank about x, rod, slider along x: a spherical joint at the pin, a universal at the slider.

    The crank angle is 0 when the crank points along +z; the slider coordinate is its x.
    Frame G is on the slider.

    Args:
        variant: "A": centre of mass of the crank on its pivot, rod without inertia about its axis;
            "B": centre of mass of the crank at half its length; "C": as B, and the rod has inertia
            about its axis.
        cut: "pin", the spherical joint (3 equations), or "slider", the universal joint (4).
    """
    centre, throw, length = np.array([0.0, 0.1, 0.12]), 0.08, 0.3
    pin = centre + np.array([0.0, 0.0, throw])
    slider = np.array([math.sqrt(length**2 - pin @ pin), 0.0, 0.0])
    along = (slider - pin) / length  # of the rod at home, x axis of the rod
    # Universal joint at the slider: about its z, then about y; along = Rz(yaw) Ry(pitch) x.
    yaw, pitch = math.atan2(along[1], along[0]), -math.asin(along[2])
    axial = 4e-4 if variant == "C" else 0.0
    crank = {
        "name": "crank",
        "parent": "base",
        "joint": joint("revolute", X, centre),
        "mass": 0.12,
        "com": [0, 0, 0.0 if variant == "A" else throw / 2],
        "inertia": diagonal(1e-4, 0, 0),
    }
    sled = {"name": "slider", "parent": "base", "joint": joint("prismatic", X), "mass": 2.0}
    rod = {"mass": 0.5, "inertia": diagonal(axial, 0.004, 0.004)}
    if cut == "pin":
        bodies = [
            crank,
            sled,
            {"name": "cross", "parent": "slider", "joint": joint("revolute", Z)},
            {"name": "rod", "parent": "cross", "joint": joint("revolute", Y)}
            | rod
            | {"com": [-length / 2, 0, 0]},
        ]
        loop = {
            "first": "slider",
            "terminal": "rod",
            "closing": "crank",
            "cut": {
                "type": "R3",
                "point_on_terminal": [-length, 0, 0],
                "point_on_closing": [0, 0, throw],
            },
        }
        home = [0.0, slider[0], yaw, pitch]
    else:
        # Turned about x, y and z one after the other: the rod never points along the second axis.
        bodies = [
            crank,
            {"name": "pin1", "parent": "crank", "joint": joint("revolute", X, (0, 0, throw))},
            {"name": "pin2", "parent": "pin1", "joint": joint("revolute", Y)},
            {"name": "rod", "parent": "pin2", "joint": joint("revolute", Z)}
            | rod
            | {"com": [length / 2, 0, 0]},
            sled,
        ]
        loop = {
            "first": "crank",
            "terminal": "rod",
            "closing": "slider",
            "cut": {
                "type": "R2",
                "point_on_terminal": [length, 0, 0],
                "point_on_closing": [0, 0, 0],
                "axis_on_terminal": Y,
                "axis_on_closing": Z,
            },
        }
        (c, s), (cp, sp) = ((math.cos(x), math.sin(x)) for x in (yaw, pitch))
        turns = [math.atan2(-s * sp, cp), math.asin(c * sp), math.atan2(s, c * cp)]
        home = [0.0, *turns, slider[0]]
    dependent = [body["name"] for body in bodies if body is not crank]
    return {
        "name": "spatial_slider_crank",
        "bodies": bodies,
        "loops": [{"name": "rod", "root": "base", **loop, "dependent": dependent}],
        "home_q": home,
        "capture": {"body": "slider"},
    }


def slider_crank(independent="crank"):
    """Planar crank of 0.1 m, rod of 0.3 m, slider along x; the crank points along +y at home.

    The crank angle is counted from +x, the slider coordinate is its x. Frame G is on the slider.

    Args:
        independent: "crank" or "slider". The slider says nothing about the motion of the crank in
            the two dead centres.
    """
    throw, length = 0.1, 0.3
    x = math.sqrt(length**2 - throw**2)
    slope = math.asin(throw / length)
    dependent = [name for name in ("crank", "rod", "slider") if name != independent]
    return {
        "name": "slider_crank",
        "bodies": [
            planar_body("crank", "base", (0, 0), (0.4, (throw / 2, 0), 4e-4)),
            planar_body("rod", "crank", (throw, 0), (0.6, (length / 2, 0), 5e-3)),
            {"name": "slider", "parent": "base", "joint": joint("prismatic", X), "mass": 1.0},
        ],
        "loops": [planar_loop("pin", ("crank", "rod"), "slider", dependent, ((length, 0), (0, 0)))],
        "home_q": [math.pi / 2, -math.pi / 2 - slope, x],
        "capture": {"body": "slider"},
    }


def parallelogram(closure=None):
    """Three bars of 1 m and 1 kg, rocker and coupler in one chain that is cut at the crank's tip.

    Unlike in `four_bars` the chain has a closed form (two hinges). Angles from the vertical.
    """
    backwards = [0, 0, -1]
    bar, coupler = (1.0, (0, 0.5), 1 / 12), (1.0, (-0.5, 0), 1 / 12)
    loop = planar_loop(
        "bar", ("rocker", "coupler"), "crank", ["rocker", "coupler"], ((-1, 0), (0, 1))
    )
    return {
        "name": "parallelogram",
        "bodies": [
            planar_body("crank", "base", (0, 0), bar, backwards),
            planar_body("rocker", "base", (1, 0), bar, backwards),
            planar_body("coupler", "rocker", (0, 1), coupler, backwards),
        ],
        "loops": [loop | ({"closure": closure} if closure else {})],
        "capture": {"body": "coupler"},
    }


def isosceles_slider_crank(closure=None):
    """Slider-crank with crank and rod of 0.1 m, slider and rod in one chain (closed form).

    At crank angles of 90 deg the rod folds onto the crank and two motions meet: the slider goes on
    (x = 0.2 cos) or rests on the crank's axis.
    """
    load, rod = (0.4, (0.05, 0), 4e-4), (0.6, (0.05, 0), 5e-3)
    loop = planar_loop("pin", ("slider", "rod"), "crank", ["slider", "rod"], ((0.1, 0), (0.1, 0)))
    return {
        "name": "isosceles",
        "bodies": [
            planar_body("crank", "base", (0, 0), load),
            {"name": "slider", "parent": "base", "joint": joint("prismatic", X), "mass": 1.0},
            planar_body("rod", "slider", (0, 0), rod),
        ],
        "loops": [loop | ({"closure": closure} if closure else {})],
        "home_q": [1.0, 0.2 * math.cos(1.0), math.pi - 1.0],
        "capture": {"body": "slider"},
    }


def shrinking_leg(closure=None):
    """Universal joint, slide and a tip 0.3 m off it, pulled by a slide past the universal joint.

    At 0.2 m of that slide the leg's own slide has run in to the foot of the tip: the leg cannot be
    shorter, and the motion turns back.
    """
    next_to, height, across = 0.3, 0.4, (0.2, 0.1)
    flat = math.hypot(*across)
    out = math.sqrt(flat**2 + height**2 - next_to**2)
    turn = [math.atan2(-across[1], across[0]), math.atan2(height, flat) - math.atan2(next_to, out)]
    inertia = diagonal(0.01, 0.02, 0.025)
    loop = {
        "name": "leg",
        "root": "base",
        "first": "first",
        "terminal": "rod",
        "closing": "tip",
        "cut": {"type": "R3", "point_on_terminal": [0, next_to, 0], "point_on_closing": [0, 0, 0]},
        "dependent": ["first", "second", "rod"],
    }
    return {
        "name": "shrinking_leg",
        "bodies": [
            {
                "name": "tip",
                "parent": "base",
                "joint": joint("prismatic", [0, -1, 0], (across[0], height, across[1])),
                "mass": 1.0,
            },
            {"name": "first", "parent": "base", "joint": joint("revolute", Y)},
            {
                "name": "second",
                "parent": "first",
                "joint": joint("revolute", Z),
                "mass": 0.5,
                "com": [0.1, 0.05, 0],
                "inertia": inertia,
            },
            {
                "name": "rod",
                "parent": "second",
                "joint": joint("prismatic", X),
                "mass": 0.2,
                "inertia": inertia,
            },
        ],
        "loops": [loop | ({"closure": closure} if closure else {})],
        "home_q": [0, *turn, out],
        "capture": {"body": "tip"},
    }
