"""Optional libraries."""

from importlib import import_module
from types import ModuleType

from .errors import InputError


def load_extra(what: str, module: str, extra: str) -> ModuleType:
    """Import `module`. Raises InputError with the command to install it if it is missing. what: what needs it."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        name = module.partition(".")[0]
        if error.name != name:
            raise
        message = f"{what} needs {name}, which is not installed; pip install 'rigcast[{extra}]' brings it"
        raise InputError(message) from None
