"""Exact area of a disc, and length of a branch, in a cell.

A disc and a polygon.  The centre of the disc is first moved to the origin O.  Each edge a → b,
taken counter-clockwise, adds the signed area that the disc shares with the triangle O a b; the sum
over the edges is exact for convex and concave polygons, wherever O lies.

                  b                         d = b − a       points of the edge: a + t d
                 /                          A = d·d         B = a·d       C = a × d
            q   /                           on the circle:  t = (−B ∓ √D) / A,  D = A r² − C²
          . - ~/~ - .
       .      /      .                      p, q   where the edge enters and leaves the disc
      .      /        .                     a … p  outside:  sector r²/2 · angle(a, p)
             ---------r                     p … q  inside:   triangle  (t_q − t_p) C / 2
      .    /  O       .                     q … b  outside:  sector r²/2 · angle(q, b)
        . /          .
         p . _ _ . '                        angle(u, v) = atan2(u × v, u · v)
        /
       a

A disc and a rectangle.  With H(x) the area of the disc west of a line at x from O,

    H(x) = r² (π/2 + asin(x/r)) + x √(r² − x²) = r² s(1 − |x|/r) for x ≤ 0, else π r² minus that,

s(h) being the segment of height h of the unit disc, the area south-west of a corner (x, y) needs only H of its two lines, and the rectangle is
the sum over its four corners with signs + − + −.  One H serves a whole line of a rectilinear grid.

A branch, the line from the centre of one floe to that of another, is cut where it crosses edges; each piece
then lies in one cell.
"""

from __future__ import annotations

import math

from floebmi.kernels import jit


@jit
def sector(ux, uy, vx, vy):
    """Signed angle from u to v, seen from the origin."""
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


@jit
def disc_edge(ax, ay, bx, by, r):
    """Twice the signed area that the disc of radius r about O shares with the triangle O a b."""
    dx, dy = bx - ax, by - ay
    A = dx * dx + dy * dy
    if A == 0.0:
        return 0.0
    B = ax * dx + ay * dy
    C = ax * dy - ay * dx
    D = A * r * r - C * C
    if D <= 0.0:
        return r * r * sector(ax, ay, bx, by)
    root = math.sqrt(D)
    t_p, t_q = (-B - root) / A, (-B + root) / A
    if t_p >= 1.0 or t_q <= 0.0:
        return r * r * sector(ax, ay, bx, by)
    angle = 0.0
    if t_p > 0.0:
        angle += sector(ax, ay, ax + t_p * dx, ay + t_p * dy)
    else:
        t_p = 0.0
    if t_q < 1.0:
        angle += sector(ax + t_q * dx, ay + t_q * dy, bx, by)
    else:
        t_q = 1.0
    return r * r * angle + (t_q - t_p) * C


@jit
def disc_polygon(corner_x, corner_y, x, y, r):
    """Area of a disc in a simple polygon, convex or concave, corners counter-clockwise [m²].

    Parameters
    ----------
    corner_x, corner_y : (k,) corners [m]; the first may be repeated at the end
    x, y, r : centre and radius of the disc [m]
    """
    twice = 0.0
    k = corner_x.size - 1
    for m in range(corner_x.size):
        twice += disc_edge(corner_x[k] - x, corner_y[k] - y, corner_x[m] - x, corner_y[m] - y, r)
        k = m
    return 0.5 * twice


# s(h) over h^(3/2), h = 0 … 1: a polynomial in 2 h − 1, interpolated at Chebyshev points, within 6e-17 of
# (acos(1 − h) − (1 − h) √(2 h − h²)) / h^(3/2).  Coefficients of the even and of the odd powers.
EVEN = (
    1.7371770873806551, -8.779284872174e-03, -1.8258110411525902e-04, -7.571550556357413e-06,
    -4.1611048759902377e-07, -2.6708789646852933e-08, -1.9053409611095405e-09, -1.327408887000293e-10,
    -1.6938704942330393e-11,
)  # fmt: skip
ODD = (
    -1.562758882878033e-01, -1.0977312731847981e-03, -3.5415582409041966e-05, -1.7315790080773544e-06,
    -1.0384600074215956e-07, -7.073189254510742e-09, -4.850629678204799e-10, -5.795678616441545e-11,
)  # fmt: skip


@jit
def horner(coefficients, x):
    """The polynomial with these coefficients, in ascending order of powers."""
    total = coefficients[-1]
    for k in range(len(coefficients) - 2, -1, -1):
        total = total * x + coefficients[k]
    return total


@jit
def disc_west(x, r):
    """H: area of the disc about O that lies west of the line at x [m²].

    It compiles inline, whereas `asin` of the C library would take as long as all the rest; and for a line almost tangent
    to the disc it uses r − |x| directly, a difference that x/r would lose to rounding.
    """
    h = max(r - abs(x), 0.0) / r
    t = 2.0 * h - 1.0
    segment = r * r * h * math.sqrt(h) * (horner(EVEN, t * t) + t * horner(ODD, t * t))
    return math.pi * r * r - segment if x > 0.0 else segment


@jit
def disc_south_west(x, y, west, south, r):
    """Area of the disc about O south-west of the corner (x, y), from H of its lines [m²]."""
    full = math.pi * r * r  # all cases are computed, to avoid an unpredictable branch
    inside = x * y + 0.5 * (west + south) - 0.25 * full
    # a corner outside the disc: the overlap of the two parts, or the smaller one, which lies in the other
    beyond = max(west + south - full, 0.0) if x * y > 0.0 else min(west, south)
    return inside if x * x + y * y < r * r else beyond


@jit
def cut(px, py, dx, dy, ax, ay, bx, by):
    """Position t in (0, 1) at which the branch p + t d crosses the edge a → b; −1 if it does not.

    Edges count as slightly longer than they are: an extra cut only splits a piece in two, whereas a cut
    missed at a corner would assign a piece to the wrong cell.
    """
    ex, ey = bx - ax, by - ay
    area = dx * ey - dy * ex
    if area == 0.0:  # parallel: the adjoining edges make the cuts at the ends of this one
        return -1.0
    t = ((ax - px) * ey - (ay - py) * ex) / area
    s = ((ax - px) * dy - (ay - py) * dx) / area
    return t if 0.0 < t < 1.0 and -1e-9 <= s <= 1.0 + 1e-9 else -1.0


@jit
def lens(r_i, r_j, distance):
    """Area of the intersection of two discs [m²] whose centres are `distance` [m] apart."""
    if distance >= r_i + r_j:
        return 0.0
    small = min(r_i, r_j)
    if distance <= abs(r_i - r_j):
        return math.pi * small * small
    area = 0.0
    for a, b in ((r_i, r_j), (r_j, r_i)):
        cosine = (distance * distance + a * a - b * b) / (2.0 * distance * a)
        angle = math.acos(min(max(cosine, -1.0), 1.0))
        area += a * a * (angle - math.sin(angle) * math.cos(angle))
    return area
