"""The same in floebmi.

Arguments: file of discs (npz), law ("frictional", "drag", "cohesive"), step, steps to warm up, steps to time.
"""

import json
import sys
import time

import numpy as np

import floebmi as fb
from floebmi.advance import Advance

LAWS = {
    "frictional": (fb.frictional(), ()),
    "drag": (fb.frictional(), (fb.OceanDrag(), fb.AirDrag())),
    "cohesive": (fb.cohesive(), ()),
}
discs = np.load(sys.argv[1])
(contact, forces), dt, warm, steps = LAWS[sys.argv[2]], float(sys.argv[3]), *map(int, sys.argv[4:])
side = (0.0, float(discs["side"]))
floes = fb.Floes(discs["x"], discs["y"], discs["radius"], 1.0, discs["u"], discs["v"])
model = fb.Model(
    fb.Domain(side, side, *["periodic"] * 4), floes, contact, forces, step=fb.Step(length=dt)
)


def look() -> dict[str, float]:
    spin = 0.0
    if floes.rotation:
        spin = 0.5 * (floes.moment_of_inertia(934.0) * floes.angular_velocity**2).sum()
    return {
        "energy": 0.5 * (floes.mass(934.0) * (floes.u**2 + floes.v**2)).sum(),
        "spin": spin,
        "contacts": 2 * len(model.contacts().i) / len(floes),
    }


model.advance(warm * dt)
first, rebuilds, listed = look(), model.counters.rebuilds, []
renew = Advance._renew


def timed(*arguments: object) -> None:
    start = time.perf_counter()
    renew(*arguments)
    listed.append(time.perf_counter() - start)


Advance._renew = timed
start = time.perf_counter()
model.advance(steps * dt)
seconds = time.perf_counter() - start
rebuilds = model.counters.rebuilds - rebuilds
result = {"seconds": seconds, "rebuild": sum(listed), "rebuilds": rebuilds}
print(json.dumps(result | {"first": first, "last": look()}))
print(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")))
