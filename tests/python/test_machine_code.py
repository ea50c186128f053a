"""The kernels' machine code: where instances are stepped, nothing is called.

A call passes lanes through memory, and mostly it is one that nobody wrote: a copy or a filling of memory that the
compiler saw in a loop; a function that it did not inline, and so did not compile for the wider instruction set either;
one of the C library, where the machine lacks an instruction; a panic.
"""

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import capstone
import pytest
from elftools.elf.elffile import ELFFile

from uvms_gym import _core

PRECISIONS = {"float32": "6single", "float64": "6double"}
LANES = {"avx512": "6avx512", "avx2": "4avx2", "neon": "4neon", "fma": "3fma", "plain": "5plain"}


class Architecture(NamedTuple):
    """Architecture: disassembler, mnemonics of calls, jumps, indirect jumps, stubs, and lanes."""

    disassembler: tuple[int, int]
    calls: set[str]
    jumps: re.Pattern[str]
    indirect: re.Pattern[str]
    through: re.Pattern[str]
    lanes: set[str]


ARCHITECTURES = {
    "EM_X86_64": Architecture(
        (capstone.CS_ARCH_X86, capstone.CS_MODE_64),
        {"call"},
        re.compile(r"j\w+"),
        re.compile(r"jmp (?!0x).*"),
        re.compile(r"qword ptr \[rip ([+-]) (0x[0-9a-f]+)\]"),
        {"avx512", "avx2", "fma", "plain"},
    ),
    "EM_AARCH64": Architecture(
        (capstone.CS_ARCH_ARM64, capstone.CS_MODE_ARM),
        {"bl", "blr"},
        re.compile(r"b(\.\w+)?|cbn?z|tbn?z"),
        re.compile(r"br .*"),
        re.compile(r"(?!)"),
        {"neon", "fma", "plain"},
    ),
}

# What the kernels that step begin with: working memory, some with memory for parameters of single instances.
MEMORY = re.compile("4step.*6memory|17memory_and_system")
# Routines of kernels that are functions of their own, compiled for the same instruction set.
ROUTINE = r"4lane(3x86|4neon|6scalar)\w+4callI"
# Those that do a step of an integrator.
STEP = ROUTINE + r".*stepping4step(13WithBaselinesI\w+?)?12(Explicit|Implicit)Step"
# What they may call, and why.
AROUND_STEPS = {
    MEMORY.pattern: "before the first instance",
    r"13return_memory": "keeps both, after the last",
    r"drop_in_place.*(6system|5hydro)|5alloc(3vec|7raw_vec).*4drop": "frees it where nobody will need it",
    r"___rust_dealloc": "the same",
    r"^_Unwind_Resume$|panic_in_cleanup": "the same after a panic",
    r"3Isa8detected|10std_detect|9panic_fmt": "the instruction set of a routine in scalar lanes, and its absence",
    ROUTINE + r".*11own_numbers11LoadNumbers": "numbers of single instances, before their steps",
    STEP: "the step itself",
}
# What steps call for what few scenes have, and nothing else does.
OF_STEPS = {
    ROUTINE + r".*8dynamics7contact(15ContactWrenches|11ContactRate)": "contact, where a scene has it",
    ROUTINE + r".*8dynamics12articulation6Across": "a joint of no common kind, where inertias are in memory",
    r"10std_detect|9panic_fmt": "the instruction set of a routine in scalar lanes, and its absence",
}
# What routines on dual numbers may call: a 6-vector of them has 384 bytes, and the compiler writes out copies of
# at most 8 stores, 256 bytes of AVX2. Explicit methods copy one a stage, linearly implicit ones at most five.
OF_DUALS = {r"^mem(cpy|move)$": "copies 6-vectors", r"^r[a-z0-9]+$": "the same through a register"}
LANES_OF_DUALS = {"avx2", "neon"}
# The adjoint of steps, and the steps that it records.
ADJOINT = r"stepping7adjoint7Reverse|stepping7reverse18ReverseSubInterval|8recorder10StepRecord"
# What it may call besides what kernels elsewhere may.
OF_ADJOINT = {
    r"4lane4tape.*4grow|7raw_vec.*8grow_one": "records that grow",
    r"11ScratchPool.*(take|put)|7adjoint11make_memory|drop_in_place.*3Vec": "memory of the reverse",
    r"10parameters.*4Step.*6system": "memory for systems with parameters per instance",
    r"10StepRecord.*4trim": "the same, after the last instance",
    r"7adjoint.*8Portions4next|7reverse11interrupted": "room for the records of many steps, and whether to go on",
    r"17NeverShortCircuit": "parts that several reverses share",
    r"21detect_and_initialize": "the instruction set of a routine in scalar lanes",
}
# What kernels that run once in a control period, or seldom, may call besides.
ELSEWHERE = {
    r"^mem(cpy|set|move)$|as_flattened|copy_from_slice|spec_fill": "fills and copies tables",
    r"4core(9panicking|5slice5index)": "checks bounds",
    r"Scratch.*3new|15allocate_scaled": "working memory of those that only work out accelerations",
    r"14InstanceSystem.*8allocate": "the same",
    r"7control.*(allocate|wrench|normalise)|8nalgebra": "classical controllers: scalars, once in a control period",
    r"^r[a-z0-9]+$": "one of these through a register",
    ROUTINE: "routines that several kernels share",
}
# Modules of controllers with a model.
MODEL = r"7control(3mpc|4nmpc|4rows|5plant|8observer|11model_based|13observer_bank)"
# What these controllers may call besides those: they plan once in a control period.
PLANNING = {
    MODEL: "plans, actions of wrenches, decay of lags",
    r"^(exp|ceil|floor|fma)$": "decays of observers",
    r"^(calloc|malloc|free|realloc|posix_memalign)$|___rust_(alloc|dealloc|no_alloc)": "memory of a call",
    r"5alloc(7raw_vec|3vec)|drop_in_place.*3vec|rotate_right": "memory of a call and of observers",
    r"6limits9interrupt9requested": "asks whether to go on, once for each group of lanes",
}


class Function(NamedTuple):
    """A function of the module."""

    name: str
    start: int
    code: bytes


class Module:
    """The native module as a file."""

    def __init__(self, path: str) -> None:
        with open(path, "rb") as file:
            elf = ELFFile(file)
            self.architecture = ARCHITECTURES[elf["e_machine"]]
            table = elf.get_section_by_name(".symtab")
            assert table is not None, "the module is stripped of its symbols"
            symbols = [s for s in table.iter_symbols() if s["st_info"]["type"] == "STT_FUNC" and s["st_size"]]
            self.text, self.code = elf.get_section_by_name(".text")["sh_addr"], elf.get_section_by_name(".text").data()
            self.functions = [
                Function(s.name, s["st_value"], self.code[s["st_value"] - self.text :][: s["st_size"]]) for s in symbols
            ]
            self.names = {s["st_value"]: s.name for s in symbols}
            # The addresses in tables through which functions are called, and the stubs that jump through them.
            dynamic = elf.get_section_by_name(".dynsym")
            for section in filter(None, map(elf.get_section_by_name, (".rela.dyn", ".rela.plt"))):
                for entry in section.iter_relocations():
                    name = dynamic.get_symbol(entry["r_info_sym"]).name
                    self.names[entry["r_offset"]] = name or self.names.get(entry["r_addend"], "")
            for section in filter(None, map(elf.get_section_by_name, (".plt", ".plt.got", ".plt.sec"))):
                for address, size, _, operand in self.instructions(section["sh_addr"], section.data()):
                    if through := self.architecture.through.fullmatch(operand):
                        name = self.names.get(address + size + int("".join(through.groups()), 16), "")
                        self.names.update({address - before: name for before in range(16)})

    def instructions(self, start: int, code: bytes) -> Iterator[tuple[int, int, str, str]]:
        """Address, size, name and operand of each."""
        return iter(capstone.Cs(*self.architecture.disassembler).disasm_lite(code, start))

    def calls(self, function: Function) -> Iterator[str]:
        """Names of what the function calls, or jumps to for good; the operand where there is no name."""
        end = function.start
        for address, size, mnemonic, operand in self.instructions(function.start, function.code):
            end = address + size
            target = None
            if there := re.fullmatch(r"(?:.*, )?#?(0x[0-9a-f]+)", operand):
                target = int(there[1], 16)
            leaves = target is not None and not 0 <= target - function.start < len(function.code)
            through = self.architecture.through.fullmatch(operand)
            jumps = (leaves or through) and self.architecture.jumps.fullmatch(mnemonic)
            if mnemonic in self.architecture.calls or jumps:
                if through:
                    target = end + int("".join(through.groups()), 16)
                yield self.names.get(target, "") or operand
        assert end == function.start + len(function.code), f"{function.name}: no instruction at {end:#x}"

    def indirect_jumps(self, function: Function) -> list[str]:
        """Jumps of a function by a register or memory: mostly through a table of addresses."""
        code = self.instructions(function.start, function.code)
        jumps = (f"{mnemonic} {operand}" for _, _, mnemonic, operand in code)
        return [jump for jump in jumps if self.architecture.indirect.fullmatch(jump)]


@cache
def module() -> Module:
    return Module(_core.__file__)


def kernels(dtype: str, lanes: str) -> list[Function]:
    """All kernels of this precision and width."""
    name = re.compile(f"lane8dispatch{PRECISIONS[dtype]}{LANES[lanes]}3run")
    return [function for function in module().functions if name.search(function.name)]


def steps(dtype: str, lanes: str) -> list[Function]:
    """Kernels that step: one for numbers of single instances; of wide lanes one for shared ones, and one of duals."""
    forward = (function for function in kernels(dtype, lanes) if not re.search(ADJOINT, function.name))
    return [function for function in forward if any(map(MEMORY.search, module().calls(function)))]


def routines() -> list[Function]:
    """Parts of kernels that are functions of their own."""
    return [function for function in module().functions if re.search(ROUTINE, function.name)]


def plans(function: Function) -> bool:
    """True for a controller with a model."""
    return any(re.search(MODEL, call) for call in [function.name, *module().calls(function)])


def others(function: Function, allowed: dict[str, str]) -> dict[str, int]:
    """Calls of a function beyond the allowed ones, with their counts."""
    calls = Counter(module().calls(function))
    return {call: count for call, count in calls.items() if not any(re.search(name, call) for name in allowed)}


@pytest.mark.parametrize("dtype", PRECISIONS)
@pytest.mark.parametrize("lanes", LANES)
def test_where_instances_are_stepped_nothing_is_called(dtype: str, lanes: str) -> None:
    # Single precision has wider lanes in place of scalars with fused multiply-add.
    if lanes not in module().architecture.lanes or (dtype, lanes) == ("float32", "fma"):
        assert not kernels(dtype, lanes)
        return
    found = steps(dtype, lanes)
    assert len(found) == (1 if lanes in ("fma", "plain") else 2) + (dtype == "float64" and lanes in LANES_OF_DUALS)
    for step in found:
        assert others(step, AROUND_STEPS | OF_STEPS) == {}, step.name


@pytest.mark.parametrize("dtype", PRECISIONS)
@pytest.mark.parametrize("lanes", LANES)
def test_where_instances_are_stepped_no_jump_goes_by_a_table(dtype: str, lanes: str) -> None:
    """Jump tables are off by .cargo/config.toml; RUSTFLAGS in the environment take its place, and bring them back."""
    of_steps = (routine for routine in routines() if re.search(STEP, routine.name))
    for step in [*steps(dtype, lanes), *of_steps]:
        assert module().indirect_jumps(step) == [], step.name


@pytest.mark.parametrize("dtype", PRECISIONS)
@pytest.mark.parametrize("lanes", LANES)
def test_every_kernel_is_inlined_and_none_needs_the_c_library_to_calculate(dtype: str, lanes: str) -> None:
    for kernel in kernels(dtype, lanes):
        allowed = AROUND_STEPS | ELSEWHERE | (PLANNING if plans(kernel) else {})
        allowed |= OF_ADJOINT if re.search(ADJOINT, kernel.name) else {}
        assert others(kernel, allowed) == {}, kernel.name


def test_routines_are_inlined_too() -> None:
    found = routines()
    assert sum(bool(re.search(STEP, routine.name)) for routine in found) >= len(PRECISIONS) * 2 * 2
    for routine in found:
        of_step = OF_STEPS | (OF_DUALS if "OnDuals" in routine.name else {})
        allowed = of_step if re.search(STEP, routine.name) else ELSEWHERE
        allowed = allowed | OF_ADJOINT if re.search(ADJOINT, routine.name) else allowed
        assert others(routine, allowed) == {}, routine.name


def test_calls_are_seen() -> None:
    """Calls of all kinds, in the functions that choose the lanes."""
    choice = re.compile("8dispatch6(single|double).*4Real(8dispatch|14dispatch_fused|15dispatch_narrow)")
    choosing = [function for function in module().functions if choice.search(function.name)]
    called = {call for function in choosing for call in module().calls(function)}
    for isa in module().architecture.lanes:
        assert any(re.search(f"8dispatch6(single|double){LANES[isa]}(?![a-z])", call) for call in called), isa
    everything = Counter(call for function in module().functions[::50] for call in module().calls(function))
    for name in (r"^mem(cpy|set)$", "9panicking", "^_Unwind_Resume$", r"^\w+$"):
        assert any(re.search(name, call) for call in everything), name
