"""How the stabilised pair of ``src/integrate/runge_kutta.cpp`` was found; prints such a pair.

Three steps, each a small optimisation:

1. the polynomial of stability of order 4 with 8 stages that allows the longest step on the spectrum
   of a docking: friction in contact (real) and rings and latches that swing (complex);
2. coefficients with that polynomial, order 4 and the last stage at the end of the step, of least
   error of order 5 and with stages that are stable on the spectrum, too;
3. an estimate of order 3 that is as small as it can be on the spectrum, and dense output.

The second one has many minima of the same quality, and rounding decides in which one it ends: the
pair in use is one of them, with the same polynomial. Its properties are tested in
``tests/unit/runge_kutta_test.cpp``.

    .venv/bin/python tests/studies/stabilised_pair.py        # half a minute
"""

import math

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from scipy.optimize import least_squares, linprog

STAGES, ORDER = 8, 4
REAL = 2900.0  # 1/s, fastest decay in the default docking
SWINGING = [-157 + 422j, -40 + 316j, -78 + 251j, -90 + 416j, -60 + 438j, -101 + 363j]  # 1/s
DAMPING = 0.981  # largest growth on the sampled spectrum
DEFECT = 1e-3  # of the estimate: its weight of A A c
ROWS = np.tril_indices(STAGES, -1)
CIRCLE = np.exp(1j * np.linspace(0, 2 * np.pi, 24, endpoint=False))


def find_spectrum():
    """Sampled eigenvalues [1/s], shape (n,)."""
    t = np.linspace(0, 1, 60)[1:]
    real = -REAL * np.concatenate([t, 1 - 0.2 * t**2])
    return np.concatenate([real + 0j, *(pair * np.linspace(0, 1, 20)[1:] for pair in SWINGING)])


def find_polynomial(z):
    """Least growth on z, and the coefficients of 1, z, ... z^8 that have it."""
    scale = np.abs(z).max()
    x = z / scale
    fixed = sum(z**k / math.factorial(k) for k in range(ORDER + 1))
    free = [
        x ** (ORDER + 1) * chebyshev.chebval(1 + 2 * x, [0] * j + [1])
        for j in range(STAGES - ORDER)
    ]
    free = np.array(free).T
    rows = np.vstack([np.c_[(free * a).real, -np.ones(len(z))] for a in CIRCLE])
    limits = np.concatenate([-(fixed * a).real for a in CIRCLE])
    cost = np.r_[np.zeros(STAGES - ORDER), 1]
    bounds = [(None, None)] * (STAGES - ORDER) + [(0, None)]
    found = linprog(cost, A_ub=rows, b_ub=limits, bounds=bounds).x
    gamma = np.array([1 / math.factorial(k) if k <= ORDER else 0.0 for k in range(STAGES + 1)])
    for j, weight in enumerate(found[:-1]):
        for k, t in enumerate(chebyshev.cheb2poly([0] * j + [1])):
            for i, a in enumerate(t * polynomial.polypow([1, 2], k)):
                gamma[ORDER + 1 + i] += weight * a / scale ** (ORDER + 1 + i)
    return found[-1], gamma


def find_conditions(a, b):
    """Defects of order 4 and of the last stage; error coefficients of order 5."""
    c = a.sum(1)
    ac, acc = a @ c, a @ c**2
    order = [b.sum() - 1, b @ c - 1 / 2, b @ c**2 - 1 / 3, b @ ac - 1 / 6, b @ c**3 - 1 / 4]
    order += [b @ (c * ac) - 1 / 8, b @ acc - 1 / 12, b @ (a @ ac) - 1 / 24, c[-1] - 1]
    error = [(b @ c**4 - 1 / 5) / 24, (b @ (c**2 * ac) - 1 / 10) / 2, (b @ ac**2 - 1 / 20) / 2]
    error += [(b @ (c * acc) - 1 / 15) / 2, (b @ (a @ c**3) - 1 / 20) / 6]
    error += [b @ (c * (a @ ac)) - 1 / 30, b @ (a @ (c * ac)) - 1 / 40]
    error += [(b @ (a @ acc) - 1 / 60) / 2, b @ (a @ (a @ ac)) - 1 / 120]
    return np.array(order), np.array(error)


def find_growth(a, z):
    """Stages of y' = z y / h, shape (stages, n)."""
    growth = np.ones((len(a), len(z)), complex)
    for j in range(1, len(a)):
        growth[j] = 1 + z * (a[j, :j] @ growth[:j])
    return growth


def unpack(x):
    """Matrix and weights from the unknowns."""
    a = np.zeros((STAGES, STAGES))
    a[ROWS] = x[: len(ROWS[0])]
    return a, x[len(ROWS[0]) :]


def find_coefficients(gamma, z):
    """Coefficients with a polynomial of stability, to rounding."""

    def residual(x, weight):
        a, b = unpack(x)
        order, error = find_conditions(a, b)
        v, moments = b, []
        for k in range(1, STAGES + 1):
            if k > ORDER:
                moments.append(v.sum() / gamma[k] - 1)
            v = a.T @ v
        over = np.log1p(np.maximum(np.abs(find_growth(a, z[::3])) - 1, 0))[1:]
        c = a.sum(1)
        outside = np.r_[np.maximum(-c, 0), np.maximum(c - 1, 0)]
        bounds = [weight * over.ravel() / math.sqrt(over.size), 10 * outside, 0.003 * x]
        return np.r_[1e3 * order, 1e3 * np.array(moments), 30 * error, *bounds]

    random = np.random.default_rng(1)
    c = np.linspace(0, 1, STAGES + 1)[:STAGES] * random.uniform(0.7, 1.0)
    a = np.zeros((STAGES, STAGES))
    for j in range(1, STAGES):
        a[j, j - 1] = c[j] * 0.6
        a[j, :j] += c[j] * 0.4 / j
    a[ROWS] += 0.05 * random.normal(size=len(ROWS[0]))
    x = np.r_[a[ROWS], np.full(STAGES, 1 / STAGES)]
    for weight in (0.3, 1.0, 3.0):
        x = least_squares(residual, x, args=(weight,), max_nfev=400).x
    for _ in range(5):  # the conditions to rounding, by the least change
        x = x.astype(np.longdouble)
        order = find_conditions(*unpack(x))[0]
        step = 1e-7
        rows = [find_conditions(*unpack(x + step * e))[0] - order for e in np.eye(len(x))]
        x = x - np.linalg.pinv(np.array(rows, float).T / step) @ order.astype(float)
    return unpack(x.astype(float))


def find_estimate(a, b, z):
    """Weights of the error estimate and of dense output, rates at the end included."""
    n = STAGES + 1
    whole = np.zeros((n, n))
    whole[:STAGES, :STAGES], whole[STAGES, :STAGES] = a, b
    c = whole.sum(1)
    ac = whole @ c
    sizes = (z * find_growth(whole, z)).T
    rows = [np.c_[(sizes * e).real, -np.ones(len(z)), np.zeros(len(z))] for e in CIRCLE]
    rows += [np.c_[sign * np.eye(n), np.zeros(n), -np.ones(n)] for sign in (1, -1)]
    limits = np.zeros(sum(len(row) for row in rows))
    equal = np.array([np.ones(n), c, c**2, ac, whole @ ac])
    cost = np.r_[np.zeros(n), 1, 1]
    bounds = [(None, None)] * n + [(0, None)] * 2
    error = linprog(
        cost,
        A_ub=np.vstack(rows),
        b_ub=limits,
        A_eq=np.c_[equal, np.zeros((5, 2))],
        b_eq=[0, 0, 0, 0, DEFECT],
        bounds=bounds,
    ).x[:n]
    # The cubic through both ends, half way, and what it lacks there up to order 4.
    cubic = np.r_[b / 2, 0]
    cubic[0] += 1 / 8
    cubic[-1] -= 1 / 8
    trees = np.array([np.ones(n), c, c**2, ac, c**3, c * ac, whole @ c**2, whole @ ac])
    exact = np.array([1 / 2, 1 / 8, 1 / 24, 1 / 48, 1 / 64, 1 / 128, 1 / 192, 1 / 384])
    return error, np.linalg.lstsq(trees, 16 * (exact - trees @ cubic), rcond=None)[0]


def main():
    """Print the tables as runge_kutta.cpp has them."""
    spectrum = find_spectrum()
    steps = [h for h in np.arange(4, 13, 0.1) * 1e-3 if find_polynomial(h * spectrum)[0] <= DAMPING]
    z = max(steps) * spectrum
    gamma = find_polynomial(z)[1]
    a, b = find_coefficients(gamma, z)
    error, dense = find_estimate(a, b, z)
    print(f"longest step {1e3 * max(steps):.1f} ms, {REAL * max(steps):.1f} on the real axis")
    print(f"largest growth of a stage {np.abs(find_growth(a, z)).max():.2f}")
    print(f"error of order 5: {np.linalg.norm(find_conditions(a, b)[1]):.1e}")
    for name, values in (("A", a[ROWS]), ("B", b), ("E", error), ("Dense", dense)):
        print(f"kStable{name}", ", ".join(repr(float(v)) for v in values))


if __name__ == "__main__":
    main()
