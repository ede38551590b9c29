"""How long the gap workflow takes on a log of ten minutes of a six-joint arm at 100 Hz, and over identification.

Run ``python benchmarks/gap_time.py``; two effects are hidden in the log. Seconds are this machine's, the ratio is not.
"""

import time

from comparisons.hidden_effects.cases import Case, Hidden, Maker
from comparisons.hidden_effects.styles import Style, reference
from comparisons.protocols.experiments import Experiments
from ident import identify
from ident.gap import baseline_model, find_gap

STYLE = Style((("fourier", 250.0), ("slow", 150.0), ("stop_and_go", 200.0)))


def main(style: Style = STYLE) -> None:
    maker = Maker(Case("ur10", (Hidden("stribeck", 1, 1.0), Hidden("load-friction", 3, 1.0)), 6))
    paths = [reference(maker.robot, kind, seconds, 60 + k, 100.0) for k, (kind, seconds) in enumerate(style.pieces)]
    scene = maker.scene(paths)
    noise, strengths = maker.measure([scene])
    log = maker.log(scene, maker.hidden(scene, strengths)[0].sum(axis=0), noise, 0)
    identify(maker.robot, [log], cutoff=8.0, effects=("coulomb",))  # compiles what both need
    begun = time.perf_counter()
    identify(maker.robot, [log])
    single = time.perf_counter() - begun
    begun = time.perf_counter()
    model = baseline_model(maker.robot, [log])
    found = find_gap(model, [log], motions=Experiments(maker.robot))
    seconds = time.perf_counter() - begun
    print([(f.effect, [j + 1 for j in f.joints], f.alternatives) for f in found.findings])
    length, ratio = log.t[-1] - log.t[0], seconds / single
    print(f"{length:.0f} s of log: {seconds:.0f} s, {ratio:.1f} times identify with its choice of terms")


if __name__ == "__main__":
    main()
