"""Attributes that cannot be set after construction, because other attributes are computed from them."""

from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    fixed = property
else:

    class fixed(property):
        """A property for which nothing can be assigned; the error says what to do instead."""

        def __set__(self, instance: object, value: Any) -> NoReturn:
            del value
            kind = type(instance).__name__
            raise AttributeError(f"{kind}.{self.fget.__name__} cannot be set; make a new {kind}")
