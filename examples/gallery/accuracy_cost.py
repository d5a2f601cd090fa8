"""
Accuracy against cost
=====================

What may be coarser, and what does it buy? Six hours of the Labrador Sea, each setting against a fine reference.
``floebmi tradeoff SCENE`` does this for all dials of a scene, with seeds, and names the setting to take.
"""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from floebmi.plot import style
from floebmi.tradeoff import member

case = {"scene": "labrador-sea", "overrides": [], "duration": 21600.0}
settings = {
    "reference": "step.fraction=0.1 time.exchange=1800",
    "as it is": "",
    "long steps": "step.fraction=0.8",
    "soft ice": "contact.youngs_modulus=3e5",
    "rare drag": "step.drag_every=16",
    "no small floes": "floes.smallest=13e3",
    "no friction": "contact.friction=0",
    "no contacts": "contact=none",
}
runs = {name: member({**case, "setting": setting}, seed=1) for name, setting in settings.items()}
flux = {name: run["velocity"][-1] for name, run in runs.items()}  # mass per area × velocity
fine = np.linalg.norm(flux.pop("reference"))
error = {n: np.linalg.norm(f - runs["reference"]["velocity"][-1]) / fine for n, f in flux.items()}
with matplotlib.rc_context({**style(), "axes.facecolor": "white"}):
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for name in error:
        axes.semilogy(runs[name]["cost_per_day"], error[name], "o", label=name)
    axes.set(xlabel="time of a processor for a simulated day [s]", ylabel="error of ice flux [1]")
    figure.legend(loc="outside right upper")
measured = float(error["soft ice"])
print(f"error with soft ice: {measured:.0%}")
