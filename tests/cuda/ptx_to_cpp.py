"""PTX, as nvcc writes it for one kernel template, to a C++ function that runs one thread of it on the CPU: so that the device's
code is tested where no device is. Every instruction becomes one statement; one that is not known here is an error, not a guess.

usage: ptx_to_cpp.py KERNEL.ptx KERNEL.cpp NAME

KERNEL.cpp defines `void NAME(int kernel, const ptx::Place&, const unsigned char* const* parameters)` (ptx_place.h), `kernel` the
template's one argument, an enumerator. It must be compiled without contraction. Source: NVIDIA, Parallel Thread Execution ISA 9.0, section 9.7.
"""
import re
import sys

C_TYPES = {
    "u32": "std::uint32_t", "s32": "std::int32_t", "b32": "std::uint32_t", "u64": "std::uint64_t", "s64": "std::int64_t",
    "b64": "std::uint64_t", "f32": "float", "f64": "double", "b16": "std::uint16_t", "b8": "unsigned char", "pred": "bool",
}
WIDER = {"u32": "u64", "s32": "s64"}
INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "rem": "%", "and": "&", "or": "|", "xor": "^"}
COMPARE = {"lt": "{a} < {b}", "le": "{a} <= {b}", "gt": "{a} > {b}", "ge": "{a} >= {b}", "eq": "{a} == {b}", "ne": "{a} != {b}",
           # of floats, true where one is no number
           "ltu": "!({a} >= {b})", "leu": "!({a} > {b})", "gtu": "!({a} <= {b})", "geu": "!({a} < {b})",
           "equ": "!({a} < {b} || {a} > {b})", "neu": "!({a} == {b})"}
PLACES = {"%tid": "thread", "%ctaid": "block", "%ntid": "threads"}


class Unknown(Exception):
    pass


def is_float(kind):
    return kind in ("f32", "f64")


def operand(text, kind):
    """C++ of one source operand, read as `kind`."""
    text = text.strip()
    if text.startswith("%") and "." in text:
        register, axis = text.split(".")
        return f"place.{PLACES[register]}[{'xyz'.index(axis)}]"
    if text.startswith("%"):
        name = text[1:]
        return name if is_float(kind) or kind == "pred" else f"static_cast<{C_TYPES[kind]}>({name})"
    if text.startswith("0f"):
        return f"std::bit_cast<float>(std::uint32_t{{0x{text[2:]}u}})"
    if text.startswith("0d"):
        return f"std::bit_cast<double>(std::uint64_t{{0x{text[2:]}u}})"
    if re.fullmatch(r"-?\d+", text):
        return f"static_cast<{C_TYPES[kind]}>({text}LL)"
    return f"ptx::address({parameter(text) if '_param_' in text else text})"


def parameter(name):
    return f"parameters[{name.rsplit('_', 1)[1]}]"


def memory(text):
    """Base and offset of [base+offset]."""
    base, _, offset = text.strip()[1:-1].partition("+")
    return base, offset or "0"


def load(op, args):
    kind = op[-1]
    base, offset = memory(args[-1])
    where = f"ptx::pointer({base[1:]}) + {offset}" if base.startswith("%") else f"{parameter(base)} + {offset}"
    targets = args[0].strip("{}").split(",") if "v2" in op else [args[0]]
    width = {"32": 4, "64": 8}[kind[1:]]
    return " ".join(f"ptx::load({t.strip()[1:]}, {where} + {i * width});" for i, t in enumerate(targets))


def store(op, args):
    base, offset = memory(args[0])
    return f"ptx::store({args[1][1:]}, ptx::pointer({base[1:]}) + {offset});"


def move(op, args):
    target, source = args
    if target.startswith("{"):
        low, high = (t.strip()[1:] for t in target.strip("{}").split(","))
        return f"ptx::unpack({source[1:]}, {low}, {high});"
    if source.startswith("{"):
        low, high = (t.strip()[1:] for t in source.strip("{}").split(","))
        return f"ptx::pack({low}, {high}, {target[1:]});"
    if op[1].startswith("b") and source.startswith("%"):
        return f"{target[1:]} = std::bit_cast<decltype({target[1:]})>({source[1:]});"
    return f"{target[1:]} = {operand(source, op[1])};"


def convert(op, args):
    target, source = op[-2], op[-1]
    a = operand(args[1], source)
    if is_float(source) and not is_float(target):
        if op[1] != "rzi":
            raise Unknown
        return f"{args[0][1:]} = ptx::truncated<{C_TYPES[target]}>({a});"
    if op[1] == "rmi":
        return f"{args[0][1:]} = std::floor({a});"
    return f"{args[0][1:]} = static_cast<{C_TYPES[target]}>({a});"


def multiply(op, args):
    kind = op[-1]
    if is_float(kind):
        return infix(op, args)
    a, b = (operand(x, kind) for x in args[1:3])
    if op[1] == "wide":
        wide = C_TYPES[WIDER[kind]]
        return f"{args[0][1:]} = static_cast<std::uint64_t>({wide}{{{a}}} * {wide}{{{b}}});"
    if op[1] != "lo":
        raise Unknown
    unsigned = "u" + kind[1:]
    product = f"{operand(args[1], unsigned)} * {operand(args[2], unsigned)}"
    return f"{args[0][1:]} = {product}" + (f" + {operand(args[3], unsigned)};" if op[0] == "mad" else ";")


def infix(op, args):
    kind = op[-1]
    if op[0] in ("add", "sub") and kind[0] == "s":
        kind = "u" + kind[1:]  # they wrap
    if is_float(kind) and op[1] != "rn":
        raise Unknown
    a, b = (operand(x, kind) for x in args[1:])
    return f"{args[0][1:]} = static_cast<decltype({args[0][1:]})>({a} {INFIX[op[0]]} {b});"


def shift(op, args):
    a, by = operand(args[1], op[-1]), operand(args[2], "u32")
    return f"{args[0][1:]} = static_cast<decltype({args[0][1:]})>(ptx::{op[0]}({a}, {by}));"


def call_of(name):
    def emit(op, args):
        return f"{args[0][1:]} = static_cast<decltype({args[0][1:]})>({name}({', '.join(operand(x, op[-1]) for x in args[1:])}));"
    return emit


def extreme(op, args):
    return call_of(("std::f" if is_float(op[-1]) else "std::") + op[0])(op, args)


def approximate(op, args):
    if op[1:] != ["approx", "ftz", "f32"]:
        raise Unknown
    return f"{args[0][1:]} = ptx::{op[0]}_approx({args[1][1:]});"


def reciprocal(op, args):
    return approximate(op, args) if op[1] == "approx" else call_of("ptx::rcp")(op, args)


def select(op, args):
    return f"{args[0][1:]} = {args[3][1:]} ? {operand(args[1], op[1])} : {operand(args[2], op[1])};"


def compare(op, args):
    if len(op) != 3:
        raise Unknown
    a, b = (operand(x, op[2]) for x in args[1:])
    return f"{args[0][1:]} = {COMPARE[op[1]].format(a=a, b=b)};"


def invert(op, args):
    return f"{args[0][1:]} = {'!' if op[1] == 'pred' else '~'}{args[1][1:]};"


def insert_bits(op, args):
    return f"{args[0][1:]} = ptx::bfi({', '.join(operand(x, 'u32') for x in args[1:])});"


EMIT = {
    "ld": load, "st": store, "mov": move, "cvt": convert, "cvta": lambda op, a: f"{a[0][1:]} = {operand(a[1], 'u64')};",
    "mul": multiply, "mad": multiply, "add": infix, "sub": infix, "div": infix, "rem": infix, "and": infix, "or": infix,
    "xor": infix, "shr": shift, "shl": shift, "fma": call_of("std::fma"), "sqrt": call_of("std::sqrt"),
    "rcp": reciprocal, "rsqrt": approximate, "max": extreme, "min": extreme, "abs": call_of("std::fabs"),
    "neg": call_of("-"), "selp": select, "setp": compare, "bfi": insert_bits, "not": invert,
}


def statement(line):
    """C++ of one instruction without its guard."""
    name, _, rest = line.partition(" ")
    op = name.split(".")
    args = [a.strip() for a in re.split(r",(?![^{]*\})", rest)] if rest.strip() else []
    if op[0] == "ret":
        return "return;"
    if op[0] == "bra":
        return f"goto {args[0][1:]};"
    if op[0] not in EMIT or ("ftz" in op and "approx" not in op):
        raise Unknown
    return EMIT[op[0]](op, args)


def body_of(text):
    for raw in text.splitlines():
        line = re.sub(r"\s+", " ", raw.split("//")[0]).strip().rstrip(";")
        if not line or line.startswith(".pragma"):
            continue
        declared = re.fullmatch(r"\.reg \.(\w+) %(\w+)(?:<(\d+)>)?", line)
        if declared:
            kind, name, count = declared.groups()
            names = [f"{name}{i}" for i in range(1, int(count))] if count else [name]
            yield f"  [[maybe_unused]] {C_TYPES[kind]} " + ", ".join(n + "{}" for n in names) + ";"
        elif line in "{}":
            yield line
        elif line.endswith(":"):
            yield f"{line[1:-1]}:;"
        else:
            guard = re.match(r"@(!?)%(p\d+) ", line)
            try:
                done = statement(line[guard.end():] if guard else line)
            except (Unknown, KeyError) as unknown:
                raise SystemExit(f"ptx_to_cpp: unknown instruction `{line}`: add it here") from unknown
            yield f"  if ({guard[1]}{guard[2]}) {{ {done} }}" if guard else f"  {done}"


def kernels_of(text):
    """Template argument and body of every kernel."""
    for entry in text.split(".entry")[1:]:
        argument = re.search(r"ILN\w*?E(\d+)EEEv", entry[:entry.index("(")])
        if not argument:
            raise SystemExit("ptx_to_cpp: a kernel that is no instance of a template of one enumerator")
        yield argument[1], entry[entry.index("\n{\n") + 3:entry.index("\n}\n")]


def main():
    source, target, name = sys.argv[1:]
    with open(source) as file:
        text = file.read()
    constants = [f"alignas({align}) const unsigned char {symbol}[] = {{{values}}};"
                 for align, symbol, values in re.findall(r"\.align (\d+) \.b8 (\w+)\[\d+\] = \{([^}]*)\};", text)]
    arguments = "[[maybe_unused]] const ptx::Place& place, const unsigned char* const* parameters"
    kernels = list(kernels_of(text))
    with open(target, "w") as file:
        file.write('#include "ptx_machine.h"\nnamespace malus::testing {\nnamespace {\n' + "\n".join(constants) + "\n")
        for number, body in kernels:
            file.write(f"void kernel_{number}({arguments}) {{\n" + "\n".join(body_of(body)) + "\n}\n")
        file.write(f"}}\nvoid {name}(int kernel, {arguments}) {{\n"
                   + "".join(f"  if (kernel == {number}) return kernel_{number}(place, parameters);\n" for number, _ in kernels)
                   + "  std::abort();\n}\n}\n")


if __name__ == "__main__":
    main()
