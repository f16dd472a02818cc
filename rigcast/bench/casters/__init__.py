"""The ray casters that are compared, each in a module of its own with its imports."""

from .caster import CASTERS, Answer, Caster, Floats, Frame, load_casters

__all__ = ["CASTERS", "Answer", "Caster", "Floats", "Frame", "load_casters"]
