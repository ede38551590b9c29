"""The catalogue: one physical cause of current a class, each with what shows it and what it is taken for."""

from importlib import import_module

from ident.effects.base import Coefficient, Context, Effect, Shape, Term
from ident.effects.survey import Survey

FILES = (
    "rigid_body",
    "attached",
    "friction",
    "friction_curve",
    "thermal",
    "hysteresis",
    "transmission",
    "ripple",
    "electrical",
    "timing",
    "contact",
)


def load_catalogue() -> dict[str, type[Effect]]:
    """Return every known effect by name: the built-in families and whatever subclass of Effect has been imported."""
    for file in FILES:
        import_module(f"ident.effects.{file}")
    return Effect.catalogue


__all__ = ["Coefficient", "Context", "Effect", "Shape", "Survey", "Term", "load_catalogue"]
