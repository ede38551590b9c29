"""The catalogue: one physical cause of current a class, one family a file."""

from importlib import import_module

from ident.effects.base import Coefficient, Context, Effect, Shape, Term

FAMILIES = ("rigid_body", "friction", "hysteresis", "transmission", "electrical")


def load_catalogue() -> dict[str, type[Effect]]:
    """Return every known effect by name: the built-in families and whatever subclass of Effect has been imported."""
    for family in FAMILIES:
        import_module(f"ident.effects.{family}")
    return Effect.catalogue


__all__ = ["Coefficient", "Context", "Effect", "Shape", "Term", "load_catalogue"]
