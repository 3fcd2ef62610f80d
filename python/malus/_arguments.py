"""One line on arguments that a function of the module does not take, in place of pybind11's list of all types."""

import difflib
import operator
import os
import re

WORDS = {"float": "a number", "int": "a whole number", "bool": "True or False", "str": "a text", "os.PathLike": "a path"}


def top_level(text):
    """The parts between commas that lie in no brackets and no quotes."""
    parts, depth, quoted = [""], 0, False
    for character in text:
        quoted ^= character == "'"
        depth += 0 if quoted else (character in "([") - (character in ")]")
        if character == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts if part.strip()]


def inner(kind, name):
    """The types in name[...], of another type none."""
    return top_level(kind[len(name) + 1:-1]) if kind.startswith(name + "[") else []


def is_whole(value):
    try:
        operator.index(value)
    except TypeError:
        return False
    return True


def is_number(value):
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return not isinstance(value, (str, bytes))


def fits(value, kind):
    if kind == "float":
        return is_number(value)
    if kind == "int":
        return is_whole(value)
    if kind == "bool":
        return value is None or hasattr(value, "__bool__") or hasattr(value, "__len__")
    if kind == "str":
        return isinstance(value, (str, bytes))
    if kind == "os.PathLike":
        return isinstance(value, (str, bytes, os.PathLike))
    if options := inner(kind, "Optional"):
        return value is None or fits(value, options[0])
    if options := inner(kind, "Union"):
        return any(fits(value, option) for option in options)
    if options := inner(kind, "List"):
        return hasattr(value, "__getitem__") and not isinstance(value, (str, bytes)) and all(fits(part, options[0]) for part in value)
    if options := inner(kind, "Tuple"):
        return hasattr(value, "__len__") and len(value) == len(options) and all(map(fits, value, options))
    if kind.startswith("malus."):
        return type(value).__name__ == kind.rpartition(".")[2]
    return True


def wanted(kind):
    if options := inner(kind, "Optional"):
        return wanted(options[0]) + ", or None"
    if options := inner(kind, "Union"):
        return " or ".join(map(wanted, options))
    if options := inner(kind, "List"):
        return "a list, each " + wanted(options[0])
    if options := inner(kind, "Tuple"):
        return f"{len(options)} values, each " + wanted(options[0])
    return WORDS.get(kind, "a " + kind.rpartition(".")[2])


def shown(value):
    text = " ".join(repr(value).split())
    return (text if len(text) < 60 else text[:57] + "...") + " (" + type(value).__name__ + ")"


def is_large(value, kind):
    """Beyond 32 bits, or negative, where a whole number is wanted: a fitting type, and yet refused."""
    return "int" in re.findall(r"\w+", kind) and is_whole(value) and not 0 <= operator.index(value) < 2**31


def explain(message, args, kwargs):
    """The line, or None where the message is another one or nothing speaks against the arguments."""
    found = re.match(r"(\w+)\(\): incompatible (?:function|constructor) arguments\..*?\n    1\. (.*?)\n(?!    2\. )", message, re.DOTALL)
    signature = found and re.match(r"([\w.]*)\((.*)\)", found[2])
    if not signature:
        return None
    name, parts = signature[1].rpartition(".")[2] or found[1], top_level(signature[2])
    free = "**kwargs" in parts
    by_place = parts.index("*") if "*" in parts else len(parts) - free
    kinds, needed = {}, []
    for part in parts:
        argument, _, rest = part.partition(": ")
        if rest:
            kind, has_default, _ = rest.partition(" = ")
            kinds[argument] = kind
            needed += [] if has_default else [argument]
    # A constructor's object is not among its documented arguments.
    args = args[1:] if signature[1] else args
    names = list(kinds)[:by_place]
    method = bool(names) and names[0] == "self"
    if len(args) > len(names):
        return f"{name} takes {len(names) - method} arguments by place, and {len(args) - method} are given; name the others"
    given = dict(zip(names, args))
    for argument, value in kwargs.items():
        if argument in given:
            return f"{argument} is given twice to {name}; leave one out"
        if argument not in kinds and not free:
            near = difflib.get_close_matches(argument, kinds, 1)
            return f"unknown keyword argument {argument} of {name}; " + (f"did you mean {near[0]}? " if near else "") + "known: " + ", ".join(
                known for known in kinds if known != "self")
        given[argument] = value
    for argument in needed:
        if argument not in given:
            return f"{argument} is missing; give {name} {wanted(kinds[argument]) if kinds[argument] != 'object' else 'one'}"
    for argument, kind in kinds.items():
        if argument in given and not fits(given[argument], kind):
            return f"{argument} is {shown(given[argument])}; give {wanted(kind)}"
    for argument, kind in kinds.items():
        if argument in given and is_large(given[argument], kind):
            return f"{argument} is {shown(given[argument])}, outside what {name} counts with; give 0 or more, of 32 bits, or 64 for a seed"
    return None
