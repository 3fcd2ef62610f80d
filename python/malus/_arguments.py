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
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return False
    return not isinstance(value, (str, bytes))


def is_true_or_false(value):
    try:
        bool(value)
    except (TypeError, ValueError, RuntimeError):
        return False
    return value is None or hasattr(value, "__bool__")


def parts_of(value):
    """Of a sequence or an array; None of anything else."""
    try:
        return None if isinstance(value, (str, bytes)) or not hasattr(value, "__getitem__") else list(value)
    except TypeError:  # an array without dimensions
        return None


def fits(value, kind):
    if kind == "float":
        return is_number(value)
    if kind == "int":
        return is_whole(value)
    if kind == "bool":
        return is_true_or_false(value)
    if kind == "str":
        return isinstance(value, (str, bytes))
    if kind == "os.PathLike":
        return isinstance(value, (str, bytes, os.PathLike))
    if options := inner(kind, "Optional"):
        return value is None or fits(value, options[0])
    if options := inner(kind, "Union"):
        return any(fits(value, option) for option in options)
    if options := inner(kind, "List"):
        return (parts := parts_of(value)) is not None and all(fits(part, options[0]) for part in parts)
    if options := inner(kind, "Tuple"):
        return len(parts_of(value) or ()) == len(options) and all(map(fits, value, options))
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
    """Beyond 32 bits, or negative, where whole numbers are wanted: a fitting type, and yet refused."""
    if "int" not in re.findall(r"\w+", kind):
        return False
    return any(is_whole(part) and not 0 <= operator.index(part) < 2**31 for part in parts_of(value) or [value])


def wrong_type(argument, value, kind):
    return f"{argument} is {shown(value)}; give {wanted(kind)}"


def too_large(argument, value):
    text = repr(value)
    bits = {"seed": 64, "frame": 32, "scene": 32}.get(argument, 31)
    return f"{argument} is {text if len(text) < 60 else text[:57] + '...'}; give 0 to 2^{bits} - 1"


def unknown_keyword(argument, name, known):
    near = difflib.get_close_matches(argument, known, 1)
    return f"unknown keyword argument {argument} of {name}; " + (f"did you mean {near[0]}? " if near else "") + "known: " + ", ".join(known)


def refused(argument, value, kind):
    """The line on a setting, one of a function's **kwargs."""
    return too_large(argument, value) if fits(value, kind) and is_large(value, kind) else wrong_type(argument, value, kind)


def signature_of(text):
    """The name with that of its class, and the parts in its brackets; None of what is no signature."""
    found = re.match(r"([\w.]*)\((.*)\)", text)
    return found and (found[1], top_level(found[2]))


def explain(message, args, kwargs, documentation):
    """The line, or None where the message is another one."""
    if (unknown := re.match(r"unknown keyword argument (.*?); .*known: (.*)", message)) and (signature := signature_of(documentation)):
        named = [part.partition(": ")[0] for part in signature[1] if ": " in part]
        return unknown_keyword(unknown[1], signature[0], [name for name in named if name != "self"] + unknown[2].split(", "))
    found = re.match(r"(\w+)\(\): incompatible (?:function|constructor) arguments\..*?\n    1\. (.*?)\n(?!    2\. )", message, re.DOTALL)
    signature = found and signature_of(found[2])
    if not signature:
        return None
    owner, parts = signature
    name = owner.rpartition(".")[2] or found[1]
    # A constructor's object is not among its documented arguments.
    return complaint(name, parts, args[1:] if owner else args, kwargs) or f"{name} does not take arguments of these types; see its help"


def complaint(name, parts, args, kwargs):
    """What speaks against the arguments, None where nothing does."""
    free = "**kwargs" in parts
    by_place = parts.index("*") if "*" in parts else len(parts) - free
    kinds, needed = {}, []
    for part in parts:
        argument, _, rest = part.partition(": ")
        if rest:
            kind, has_default, _ = rest.partition(" = ")
            kinds[argument] = kind
            needed += [] if has_default else [argument]
    names = list(kinds)[:by_place]
    method = bool(names) and names[0] == "self"
    if len(args) > len(names):
        return f"{name} takes {len(names) - method} arguments by place, and {len(args) - method} are given; name the others"
    given = dict(zip(names, args))
    for argument, value in kwargs.items():
        if argument in given:
            return f"{argument} is given twice to {name}; leave one out"
        if argument not in kinds and not free:
            return unknown_keyword(argument, name, [known for known in kinds if known != "self"])
        given[argument] = value
    for argument in needed:
        if argument not in given:
            return f"{argument} is missing; give {name} {wanted(kinds[argument]) if kinds[argument] != 'object' else 'one'}"
    for argument, kind in kinds.items():
        if argument in given and not fits(given[argument], kind):
            return wrong_type(argument, given[argument], kind)
    for argument, kind in kinds.items():
        if argument in given and is_large(given[argument], kind):
            return too_large(argument, given[argument])
    return None
