"""The one error that rigcast raises for what a user gives it."""


class InputError(ValueError):
    """Something given by the user cannot be used: a rig, a model, an array, a folder.

    The message says what is wrong, where, what was got and what was expected, one line per fault.
    """


def require_type(what: str, value: object, *kinds: type) -> None:
    """Raise InputError where `value`, which a message calls `what`, is of none of these types."""
    if not isinstance(value, kinds):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"{what}: got {type(value).__name__}, expected {expected}")
