"""Before any test imports numpy: its threads are limited by the package."""

import wineglass  # noqa: F401
