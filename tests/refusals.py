"""What must be refused, and with which words."""

import pytest


def refused(message, function, /, *arguments, **options):
    """A call raises ``ValueError`` with words that match a pattern."""
    with pytest.raises(ValueError, match=message):
        function(*arguments, **options)


def refusals(*rows, of=lambda function, *arguments: function(*arguments), before="", fixtures=()):
    """A test of each row: arguments of ``of``, and a pattern of what the refusal says.

    Without ``of`` a row begins with the function that is called. Patterns begin with ``before``.
    ``of`` takes the values of ``fixtures`` first.
    """

    @pytest.mark.parametrize("row", rows, ids=[str(row[-1]) for row in rows])
    def test(row, request):
        *arguments, message = row
        values = map(request.getfixturevalue, fixtures)
        refused(before + message, of, *values, *arguments)

    return test
