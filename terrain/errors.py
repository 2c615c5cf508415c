"""The one exception people see: one line that says what was expected, what was found and what to do."""


class InputError(Exception):
    """Bad input from outside (a file, an option, a missing system piece); printed as one line with exit status 2."""
