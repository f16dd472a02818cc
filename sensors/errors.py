"""The one error that rigcast raises for what a user gives it."""


class InputError(ValueError):
    """Something given by the user cannot be used: a rig, a model, an array, a folder.

    The message says what is wrong, where, what was got and what was expected, one line per fault.
    """
