"""Exponential map of SE(3) and dexp^-1_(-theta) at 60 digits, by their defining series alone.

    exp [xi]          = sum [xi]^k / k!              (4x4)
    dexp_(-theta)     = sum (-ad_theta)^k / (k+1)!   (6x6), which maps d(theta)/dt to the body twist of exp [theta]
    dexp^-1_(-theta)  = its inverse, by LU

Run: python exponential.py > exponential.json   (Python 3.11, mpmath 1.3.0)
"""

import json
import random

import mpmath as mp

mp.mp.dps = 60
ANGLES = [
    0.0,
    1e-12,
    1e-9,
    1e-8,
    1e-7,
    1e-6,
    1e-5,
    1e-4,
    1e-3,
    3e-3,
    1e-2,
    3e-2,
    0.1,
    0.3,
    0.7,
    1.0,
    1.5,
    2.0,
    2.5,
    3.0,
]
ANGLES += [3.1, 3.14, 3.141592653589793, 3.15, 3.3, 3.6]


def cross(a):
    return mp.matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def hat(xi):
    m = mp.zeros(4)
    m[0:3, 0:3] = cross(xi[3:])
    for i in range(3):
        m[i, 3] = xi[i]
    return m


def ad(xi):
    m = mp.zeros(6)
    m[0:3, 0:3] = m[3:6, 3:6] = cross(xi[3:])
    m[0:3, 3:6] = cross(xi[:3])
    return m


def series(m, coefficient):
    """sum coefficient(k) m^k"""
    total, power, k = mp.zeros(m.rows), mp.eye(m.rows), 0
    while k < 200:
        total, power, k = total + coefficient(k) * power, power * m, k + 1
    return total


def case(angle):
    direction = [random.gauss(0, 1) for _ in range(3)]
    length = sum(x * x for x in direction) ** 0.5
    xi = [random.uniform(-1, 1) for _ in range(3)] + [x / length * angle for x in direction]
    twist = [random.uniform(-1, 1) for _ in range(6)]
    exact = [mp.mpf(x) for x in xi]
    pose = series(hat(exact), lambda k: 1 / mp.factorial(k))
    dexp = series(-ad(exact), lambda k: 1 / mp.factorial(k + 1))
    rate = mp.lu_solve(dexp, mp.matrix([mp.mpf(x) for x in twist]))
    return {
        "angle": angle,
        "xi": xi,
        "twist": twist,
        "rotation": [[float(pose[i, k]) for k in range(3)] for i in range(3)],
        "position": [float(pose[i, 3]) for i in range(3)],
        "rate": [float(x) for x in rate],
    }


random.seed(1)
print(json.dumps([case(angle) for angle in ANGLES for _ in range(2)], indent=None).replace("}, {", "},\n{"))
