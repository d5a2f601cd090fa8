"""
Accuracy against cost
=====================

What may be coarser, what does it buy? Six hours of the Labrador Sea against a fine reference; on the front nothing is
both faster and better. ``floebmi tradeoff SCENE`` does it for all dials, with seeds, and names the setting to take.
"""

from numpy.linalg import norm

from floebmi.plot import graph
from floebmi.tradeoff import member

case = {"scene": "labrador-sea", "overrides": [], "duration": 21600.0, "every": 21600.0}
settings = {
    "reference": "step.fraction=0.1 time.exchange=1800",
    "as it is": "",
    "short steps": "step.fraction=0.3",
    "soft ice": "contact.youngs_modulus=3e5",
    "rare drag": "step.drag_every=16",
    "no small floes": "floes.smallest=13e3",
    "no contacts": "contact=none",
}
runs = {name: member({**case, "setting": setting}, seed=1) for name, setting in settings.items()}
fine = runs.pop("reference")["velocity"][-1]  # mass per area × velocity
error = {n: float(norm(one["velocity"][-1] - fine) / norm(fine)) for n, one in runs.items()}
cost = {n: float(runs[n]["cost_per_day"]) for n in error}
front = [n for n in error if all(error[n] <= error[o] or cost[n] < cost[o] for o in error)]
front.sort(key=cost.get)
with graph(7, 4) as figure:
    axes = figure.subplots()
    for n in error:
        axes.semilogy(cost[n], error[n], "o", label=n)
    axes.plot([cost[n] for n in front], [error[n] for n in front], "k:", zorder=0, label="front")
    axes.set(xlabel="CPU time per simulated day [s]", ylabel="error of ice flux [1]")
    figure.legend(loc="outside right upper")
measured = error["soft ice"]
print(f"error with soft ice: {measured:.0%}")
