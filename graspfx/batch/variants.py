"""Variants of a scene as contents of buffers: a few variants are built, and the others are assembled from these."""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import build
from graspfx.assembly.resolve import require_no_host, require_prompt_simulations, resolve
from graspfx.batch.varied_entries import Column, Columns, NotAlikeError, plain_keys
from graspfx.errors import Fault, InputError, SceneError
from graspfx.loop.arena import Arena
from graspfx.loop.servo import foreign, guests, looked_ahead

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Numbers = tuple[int, ...]  # index of each key's value

CHECKED = 8  # number of combinations to build in addition to those of extreme values
FULL = 16  # number of variants up to which all are built


@dataclass(frozen=True)
class Program:
    """Program that several variants share: a servo that was built for one of them, and the servo's arena."""

    servo: Servo
    arena: Arena

    @cached_property
    def size(self) -> int:
        """Number of entries of the arena."""
        return self.arena.memory.used

    def fill(self, arena: FloatArray) -> None:
        """Copy a variant's arena into the arena of the servo."""
        self.arena.memory.floats[: self.size] = arena

    def check_activity(self, arena: FloatArray) -> None:
        """Warn, as `gx.run` does, if the matrix gains in a variant's arena can generate energy."""
        if any(part.grasped.matrices for part in self.servo.objects):
            self.fill(arena)
            for part in self.servo.objects:
                part.grasped.check_activity()


@dataclass(frozen=True)
class Built:
    """A variant that was built from its scene.

    Attributes:
        arena: Initial contents of the variant's arena.
        layout: Digest of the layout of the arena; variants with equal digests can be run by the same servo.
    """

    arena: FloatArray
    layout: str


@dataclass
class PartMemory:
    """Programs and built variants that several `Variants` of a scene share, in one thread.

    Attributes:
        programs: Programs by digest of the layout.
        bases: Built variant, whose columns were verified, by keys and kind of their values (`Columns.kinds`).
    """

    programs: dict[str, Program] = field(default_factory=dict)
    bases: dict[Hashable, Built] = field(default_factory=dict)


@dataclass
class Group:
    """Variants that share a program.

    Attributes:
        program: Program of the variants.
        base: Contents of the arena of one variant, (arena,).
        members: Indices of the variants, (V,).
        factors: Differences from `base`. Each factor consists of indices of entries of the arena, rows with alternative
            values of these entries, and the index of each member's row, (V,).
    """

    program: Program
    base: FloatArray
    members: Index
    factors: list[tuple[Index, FloatArray, Index]] = field(default_factory=list)

    @cached_property
    def varying(self) -> Index:
        """Indices of the entries of the arena in which members differ."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(entries for entries, _, _ in self.factors)]))

    def arenas(self, members: Any) -> FloatArray:
        """Return the arenas of some members, (v, arena), given by a slice or an index array."""
        count = len(self.members[members])
        copies = np.repeat(self.base[None], count, axis=0)
        for entries, rows, choice in self.factors:
            copies[:, entries] = rows[choice[members]]
        return copies

    def add(self, columns: Iterable[Column]) -> None:
        """Add a factor with the values in `columns` of those entries that differ from `base` in some member."""
        numbers: dict[int, FloatArray] = {}
        for block, entry, values in columns:
            place = self.program.arena.place(block) + entry
            if (values.view(np.int64) != self.base[place : place + 1].view(np.int64)).any():
                numbers[place] = values
        entries = sorted(numbers)
        rows = np.stack([numbers[entry] for entry in entries], axis=1) if entries else np.empty((len(self.members), 0))
        self.factors.append((np.array(entries, dtype=np.intp), rows, np.arange(len(self.members))))


class ForeignPartsError(InputError):
    """A part of a scene is not a kernel, so that variants of the scene cannot be run as a batch."""


class Variants:
    """Variants of a scene.

    Args:
        scene: Scene of the variants.
        values: List of values of each dotted key.
        numbers: Index of each variant's value in the list of each key, (V, keys).
        beside: Values of other keys, which are equal in all variants; none if None.
        memory: Programs and built variants that are shared with other `Variants` of the scene; None to share none.
    """

    def __init__(
        self,
        scene: Scene,
        values: Mapping[str, Sequence[Any]],
        numbers: Index,
        beside: Mapping[str, Any] | None = None,
        memory: PartMemory | None = None,
    ) -> None:
        require_no_host(scene, "a batch")
        self.beside = dict(beside or {})
        self.scene, self.values, self.numbers = scene, {key: list(items) for key, items in values.items()}, numbers
        self.keys = list(self.values)
        self.notes: list[str] = []
        self._built: dict[Numbers, Built] = {}
        self.memory = PartMemory() if memory is None else memory
        self._programs = self.memory.programs

    def overrides(self, numbers: Sequence[int]) -> dict[str, Any]:
        own = {key: self.values[key][number] for key, number in zip(self.keys, numbers, strict=True)}
        return {**self.beside, **own}

    def built(self, numbers: Index) -> Built:
        """Build the variant whose values have the indices `numbers` (keys,), or return it if it was built before.

        Raises:
            SceneError: If the variant is not a valid scene; the message states its values.
            InputError: If a part of the scene is not a kernel.
        """
        key = tuple(numbers.tolist())
        if key not in self._built:
            self._built[key] = self._make(self.overrides(key))
        return self._built[key]

    def _make(self, overrides: Mapping[str, Any]) -> Built:
        text = ", ".join(f"{key} = {value!r}" for key, value in overrides.items())
        try:
            variant = self.scene.replace(overrides)
            require_prompt_simulations(resolve(variant))
            with ExitStack() as stack:
                servo = stack.enter_context(build(variant, engine="interpreted"))
                arena = servo.arena
                if not arena.is_whole:  # a large mesh
                    room = arena.memory.used + arena.size
                    servo = stack.enter_context(build(variant, engine="interpreted", room=room))
                    arena = servo.arena
                built = Built(arena.memory.floats[: arena.memory.used].copy(), _layout(arena))
        except SceneError as error:
            faults = [Fault(fault.key, fault.message) for fault in error.faults]
            raise SceneError(f"{error.source} with {text}", faults) from error
        if built.layout not in self._programs:
            others = [*foreign(servo), *guests(servo), *looked_ahead(servo), *_apart(arena)]
            if others:
                raise ForeignPartsError(
                    "scene", self.scene.source.name, "kernels for all parts",
                    f"not kernels: {', '.join(others)}; run the variants with `gx.sweep`, or one by one with `gx.run`",
                )  # fmt: skip
            self._programs[built.layout] = Program(servo, arena)
        return built

    @property
    def builds(self) -> int:
        """Number of variants that were built."""
        return len(self._built)

    def groups(self) -> list[Group]:
        """Divide all variants into groups that share a program.

        Raises:
            SceneError, InputError: As for `built`.
        """
        if len(self.numbers) > FULL and (plain := plain_keys(self.scene, resolve(self.scene), self.values)):
            return self._in_columns(plain)
        return self._of_values(np.arange(len(self.numbers)))

    def _of_values(self, members: Index) -> list[Group]:
        """Divide some variants into groups, for which one variant is built for each value of every key."""
        groups_: list[Group] = []
        for part in self._patterns(members):
            groups_ += self._split(part)
        return groups_

    # Columns ------------------------------------------------------------------------------------------------------

    def _in_columns(self, plain: Sequence[str]) -> list[Group]:
        """Divide all variants into groups; values of the plain keys are computed for many variants at once."""
        own = [self.keys.index(key) for key in plain]
        values = {
            key: np.array(self.values[key], dtype=float)[self.numbers[:, i]] for key, i in zip(plain, own, strict=True)
        }
        columns = Columns(self.scene, values)
        sound, kinds = columns.sound(resolve(self.scene)), columns.kinds()
        groups_ = self._each(np.flatnonzero(~sound))
        for kind in np.unique(kinds[sound]):
            members = np.flatnonzero(sound & (kinds == kind))
            own_values = {key: each[members] for key, each in values.items()}
            spread = self._each(members) if len(members) <= FULL else self._spread(members, own_values, own)
            groups_ += self._of_values(members) if spread is None else spread
        return groups_

    def _spread(self, members: Index, values: Mapping[str, FloatArray], own: Sequence[int]) -> list[Group] | None:
        """Divide variants of one kind into groups, and add columns with the values of the plain keys `own`.

        Return None if the columns differ from variants that were built to verify them.
        """
        middle = self.numbers[members[len(members) // 2]]
        others = [i for i in range(len(self.keys)) if i not in own]
        kind = None if others else (tuple(self.keys), int(Columns(self.scene, values).kinds()[0]))
        before = self.memory.bases.get(kind) if kind is not None else None
        base = self.built(middle) if before is None else before
        if others:
            beside = {self.keys[i]: self.values[self.keys[i]][middle[i]] for i in own}
            rest = {self.keys[i]: self.values[self.keys[i]] for i in others}
            inner = Variants(self.scene, rest, self.numbers[members][:, others], beside, PartMemory(self._programs))
            groups_ = inner.groups()
            self.notes += inner.notes
        else:
            groups_ = [Group(self._programs[base.layout], base.arena, np.arange(len(members)))]
        parts = resolve(self.scene)
        for group in groups_:
            inside = {key: each[group.members] for key, each in values.items()}
            group.members = members[group.members]
            try:
                group.add(Columns(self.scene, inside).fill(parts, group.program.servo))
                same = before is not None or self._is_as_built(group, self._extreme_ones(group, inside))
            except NotAlikeError:
                same = False
            if not same:
                self.notes.append(
                    f"{len(group.members)} variants not computed as columns, which differ from built ones"
                )
                return None
        if kind is not None:
            self.memory.bases[kind] = base
        return groups_

    def _extreme_ones(self, group: Group, values: Mapping[str, FloatArray]) -> list[int]:
        """List members to verify, by position in a group: one with an extreme value of each key, and a random one."""
        random = np.random.default_rng(len(group.members))
        some = [int(np.argmax(np.abs(each - each[len(each) // 2]))) for each in values.values()]
        return [*some, int(random.integers(len(group.members)))]

    def _is_as_built(self, group: Group, some: Iterable[int]) -> bool:
        """Return whether members at some positions in a group are bit-identical to variants built for comparison."""
        for k in dict.fromkeys(some):
            built = self.built(self.numbers[group.members[k]])
            if self._programs[built.layout] is not group.program:
                return False
            if built.arena.tobytes() != group.arenas(slice(k, k + 1))[0].tobytes():
                return False
        return True

    # Equal values -------------------------------------------------------------------------------------------------

    def _patterns(self, members: Index) -> Iterator[Index]:
        """Yield sets of variants in which the same keys have equal values; entries depend on whether kep = kip."""
        numbers = self.numbers[members]
        same = [
            self._same(key, other, numbers[:, i], numbers[:, j])
            for (i, key), (j, other) in itertools.combinations(enumerate(self.keys), 2)
        ]
        pattern = np.array(same, dtype=int).reshape(len(same), len(numbers)).T
        _, pattern_of = np.unique(pattern, axis=0, return_inverse=True) if same else (None, np.zeros(len(numbers), int))
        for k in np.unique(pattern_of):
            yield members[np.flatnonzero(pattern_of.ravel() == k)]

    def _same(self, key: str, other: str, one: Index, two: Index) -> NDArray[np.bool_]:
        """Return a mask of the variants in which two keys, whose values have the indices `one` and `two`, are equal."""
        lists = self.values[key], self.values[other]
        if all(type(each) in (int, float) for items in lists for each in items):
            a, b = (np.array(items, dtype=float) for items in lists)
            return np.asarray(a[one] == b[two])
        return np.array([[_equal(a, b) for b in lists[1]] for a in lists[0]])[one, two]

    def _tied(self, members: Index) -> list[list[int]]:
        """Divide the keys, by index, into sets of keys whose values are equal in all of some variants."""
        together: list[list[int]] = []
        for i, key in enumerate(self.keys):
            for group in together:
                j = group[0]
                first = self.numbers[members[0]]
                if _equal(self.values[key][first[i]], self.values[self.keys[j]][first[j]]):
                    group.append(i)
                    break
            else:
                together.append([i])
        return together

    # Assembly -----------------------------------------------------------------------------------------------------

    def _split(self, members: Index) -> list[Group]:
        """Divide variants, which may have different layouts, into groups, and assemble those that are not built."""
        if len(members) <= FULL:
            return self._each(members)
        middle = self.numbers[members[len(members) // 2]]
        base = self.built(middle)
        factors = self._tied(members)
        while True:
            choices = [self._choices(members, keys) for keys in factors]
            try:
                alone = [
                    [self.built(_with(middle, keys, row)) for row in rows]
                    for keys, (rows, _) in zip(factors, choices, strict=True)
                ]
            except SceneError:
                if self._is_grid():
                    raise
                return self._all(members, "a value of one key is invalid without the values of other keys")
            for (_, choice), built in zip(choices, alone, strict=True):
                layouts = [each.layout for each in built]
                kinds = [layouts.index(each) for each in layouts]
                if len(set(kinds)) > 1:
                    kind = np.array(kinds)[choice]
                    return [group for k in dict.fromkeys(kinds) for group in self._split(members[kind == k])]
            changed = [_changed(base, built) for built in alone]
            meeting = next(
                ((i, j) for i, j in itertools.combinations(range(len(factors)), 2) if changed[i] & changed[j]), None
            )
            if meeting is None:
                break
            i, j = meeting
            factors[i] = sorted(factors[i] + factors.pop(j))
        group = Group(self._programs[base.layout], base.arena, members)
        for entries, built, (_, choice) in zip(changed, alone, choices, strict=True):
            if entries:
                where = np.array(sorted(entries), dtype=np.intp)
                group.factors.append((where, np.array([each.arena[where] for each in built]), choice))
        if len(factors) < 2 or self._holds(group):
            return [group]
        return self._all(members, "the values of several keys interact")

    def _choices(self, members: Index, keys: Sequence[int]) -> tuple[Index, Index]:
        """Return the distinct combinations of values of some keys, and the index of each variant's combination."""
        rows, choice = np.unique(self.numbers[members][:, keys], axis=0, return_inverse=True)
        return rows, choice.ravel()

    def _is_grid(self) -> bool:
        """Return whether the variants are all combinations of the values of the keys."""
        return len(np.unique(self.numbers, axis=0)) == math.prod(len(np.unique(each)) for each in self.numbers.T)

    def _holds(self, group: Group) -> bool:
        """Return whether assembled variants equal built ones, for up to 64 with extreme values and some others."""
        numbers = self.numbers[group.members]
        ends = [np.isin(numbers[:, i], _extremes(self.values[key], numbers[:, i])) for i, key in enumerate(self.keys)]
        corners = np.flatnonzero(np.all(ends, axis=0))
        random = np.random.default_rng(len(numbers))
        some = random.choice(len(numbers), size=min(CHECKED, len(numbers)), replace=False)
        lone = [int(np.flatnonzero(end)[0]) for end in ends if end.any()]
        return self._is_as_built(group, [*corners[:64].tolist(), *lone, *some.tolist()])

    def _all(self, members: Index, why: str) -> list[Group]:
        self.notes.append(f"{len(members)} variants were built one by one: {why}")
        return self._each(members)

    def _each(self, members: Index) -> list[Group]:
        """Build every one of some variants, and divide them into groups by layout."""
        kinds: dict[str, list[tuple[int, Built]]] = {}
        for member in members.tolist():
            built = self.built(self.numbers[member])
            kinds.setdefault(built.layout, []).append((member, built))
        groups = []
        for layout, pairs in kinds.items():
            arenas = np.array([built.arena for _, built in pairs])
            where = np.flatnonzero((arenas.view(np.int64) != arenas[:1].view(np.int64)).any(axis=0))
            group = Group(self._programs[layout], arenas[0], np.array([member for member, _ in pairs]))
            group.factors.append((where, arenas[:, where], np.arange(len(pairs))))
            groups.append(group)
        return groups


def _layout(arena: Arena) -> str:
    """Compute the digest of an arena's layout: places of blocks, names of columns, period and world."""
    places = [(arena.place(array), array.size) for array in arena.arrays]
    columns, period = list(arena.parts.layout.columns), arena.servo.period
    return sha256(repr((places, columns, period)).encode() + bytes(arena.world.buffer)).hexdigest()


def _apart(arena: Arena) -> Iterator[str]:
    """Yield texts on parts whose data is outside the memory of an arena, so that a copy of the memory is incomplete."""
    if not arena.is_whole:
        yield "a part whose block does not fit into the arena"
    for each in arena.foreign:
        yield f"the kernel {each.kernel.__module__}.{each.kernel.__qualname__}"


def _with(numbers: Index, keys: Sequence[int], row: Sequence[int]) -> Index:
    changed = numbers.copy()
    changed[list(keys)] = row
    return changed


def _changed(base: Built, built: Sequence[Built]) -> set[int]:
    """Return the indices of the arena's entries whose bits differ between `base` and any of the other variants."""
    first = base.arena.view(np.int64)
    return {int(k) for each in built for k in np.flatnonzero(each.arena.view(np.int64) != first)}


def _extremes(values: Sequence[Any], used: Index) -> list[int]:
    """List the indices of the first, last, smallest and largest values among those that are used."""
    numbers = np.unique(used).tolist()
    extremes = [numbers[0], numbers[-1]]
    if all(isinstance(values[n], int | float) for n in numbers):
        extremes += [min(numbers, key=lambda n: values[n]), max(numbers, key=lambda n: values[n])]
    return extremes


def _equal(a: Any, b: Any) -> bool:
    """Return whether two values are equal as numbers, or as arrays if one of them is a list."""
    if type(a) in (int, float) and type(b) in (int, float):
        return bool(a == b)
    if not isinstance(a, list) and not isinstance(b, list):
        return False
    try:
        return bool(np.all(np.equal(np.asarray(a, dtype=float), np.asarray(b, dtype=float))))
    except (TypeError, ValueError):
        return False
