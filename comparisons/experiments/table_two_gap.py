"""The model of Table II with the effects that the gap workflow names, found once and kept."""

from __future__ import annotations

import json
from pathlib import Path

from comparisons.comparison.workshop import Workshop
from ident.model import CurrentModel
from ident.model_file import load_model, save_model

NAMES = "named.json"


class GapWorkshop(Workshop):
    """A workshop that also asks the gap workflow what links, Coulomb and viscous friction lack."""

    def named(self, name: str) -> tuple[CurrentModel, float, dict[str, list[int]]]:
        """Return the model with what was named, the seconds that took, and the joints (from 1) of each effect named."""

        def fit(place: Path) -> None:
            from ident.gap import baseline_model, find_gap

            def tell(what: str, share: float) -> None:
                self.progress(f"{name}: {what}", share)

            start = baseline_model(self.robot, self.logs, progress=tell)
            found = find_gap(start, self.logs, progress=tell)
            effects: dict[str, list[int]] = {}
            for finding in found.findings:
                effects.setdefault(finding.effect, []).extend(j + 1 for j in finding.joints)
            save_model(found.model, place)
            (place / NAMES).write_text(json.dumps(effects) + "\n", encoding="utf-8")

        place = self._place(name, "gap")
        seconds = self._once(place, fit)
        effects = json.loads((place / NAMES).read_text(encoding="utf-8"))
        return load_model(place, self.robot), seconds, effects
