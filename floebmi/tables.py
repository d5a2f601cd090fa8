"""Typed tables: from a text file that a person wrote to checked values, or to one line that says what is wrong.

A declaration is a NamedTuple of annotated numbers (a law) or a `Table` (a section of a scene).  The same
declaration gives the keys that are allowed, their bounds, their defaults and their description, so nothing
has to be said twice.  What pydantic finds wrong is turned into one line with file, table, key, value, what is
allowed, and a near word.

Nothing is converted in silence: text is not a number, `true` is not 1, and infinity is not allowed.
"""

import inspect
import json
import re
import tomllib
import types
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    ValidationError,
    create_model,
)
from pydantic_core import PydanticCustomError

from floebmi.errors import InputError, choose
from floebmi.quantities import type_parts


class Table(BaseModel):
    """A table of a scene file; unknown keys are errors."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Override(NamedTuple):
    """One `--set table.key=value`: the keys on the way, the value, and the words of the user."""

    keys: tuple[str, ...]
    value: Any
    text: str

    @property
    def names(self) -> tuple[str, ...]:
        """The keys without the numbers of tables in lists."""
        return tuple(part for part in self.keys if not part.isdecimal())

    def meets(self, other: "Override") -> bool:
        """Whether one of the two sets what the other sets, or a part of it."""
        return all(one == two for one, two in zip(self.names, other.names, strict=False))


# ---- declarations -----------------------------------------------------------------------------


def parameter_texts(law: object) -> dict[str, str]:
    """What the docstring of a law says of each of its parameters, `name, name : text`."""
    lines = (inspect.getdoc(law) or "").partition("Parameters\n")[2]
    found = re.findall(r"^(\w+(?:, \w+)*) : (.+(?:\n    .+)*)$", lines, re.MULTILINE)
    return {name: " ".join(text.split()) for names, text in found for name in names.split(", ")}


def table_of(law: Callable[..., Any], key: str | None = None, word: str | None = None) -> Any:
    """The `Table` with the fields of a law; with `key = "word"` in it, where several laws may stand.

    `law_of` makes the law out of the table.
    """
    texts = parameter_texts(law)
    hints = get_type_hints(law, include_extras=True)
    fields: dict[str, Any] = {}
    if key is not None:
        fields[key] = (Literal[word], Field(word, description=summary(law)))
    fields |= {
        name: (hints[name], Field(_required(one.default), description=texts.get(name)))
        for name, one in inspect.signature(law).parameters.items()
    }
    return create_model(law.__name__, __base__=Table, __doc__=law.__doc__, **fields)


def _required(default: Any) -> Any:
    return ... if default is inspect.Parameter.empty else default


def keyed(law: Any) -> Any:
    """The type of a law that stands as a table of its keys; a list does not say which number is which."""
    return Annotated[law, BeforeValidator(_no_list)]


def _no_list(value: Any) -> Any:
    if isinstance(value, list):
        raise PydanticCustomError("dict_type", "must be a table of keys")
    return value


def law_of(table: BaseModel, law: Callable[..., Any]) -> Any:
    """The law whose parameters stand in the table; the table may hold more keys."""
    return law(**{name: getattr(table, name) for name in inspect.signature(law).parameters})


def summary(thing: object) -> str:
    """The first line of a docstring."""
    return (inspect.getdoc(thing) or "").partition("\n")[0]


class ByKey:
    """Picks the declaration of a table by the word that stands at one of its keys."""

    def __init__(self, key: str, default: str | None):
        self.key, self.default = key, default
        self.__name__ = key  # pydantic wants a name of a callable

    def __call__(self, value: Any) -> str:
        if isinstance(value, dict):
            word = value.get(self.key, self.default)
        else:  # not a table: let the default declaration say so
            word = getattr(value, self.key, self.default)
        return _tag("" if word is None else word)


def one_of(key: str, choices: dict[str, Any], default: str | None = None) -> Any:
    """The type of a table whose `key` says which of the choices, tables or laws, it is."""
    members = []
    for word, choice in choices.items():
        is_table = isinstance(choice, type) and issubclass(choice, Table)
        table = choice if is_table else table_of(choice, key, word)
        members.append(Annotated[table, Tag(_tag(word))])
    return Annotated[Union[tuple(members)], Discriminator(ByKey(key, default))]  # noqa: UP007


def _word_or_table(value: Any) -> str:
    # so that an error speaks of what was meant
    return _tag("table") if isinstance(value, (dict, BaseModel, tuple)) else _tag("word")


def word_or(words: Any, table: Any) -> Any:
    """The type of a key that holds either one of some words or a table."""
    return Annotated[
        Annotated[words, Tag(_tag("word"))] | Annotated[table, Tag(_tag("table"))],
        Discriminator(_word_or_table),
    ]


def _tag(word: object) -> str:
    # never the name of a key: the path of an error can then be told from the choices made on the way
    return f"={word}"


def keys(
    table: Any, path: str = "", seen: set[tuple[str, Any]] | None = None
) -> Iterator[tuple[str, str, str, str]]:
    """Each key of a declaration once: (table, key, default, description); sub-tables after their table.

    Where several declarations may stand at one place, each begins with the word that picks it: its default is `= "word"`.
    """
    seen = set() if seen is None else seen
    inner: list[tuple[str, Any]] = []
    for name, hint in sorted(_hints(table).items(), key=lambda item: not _picks(item[1])):
        default, text = _default(table, name)
        yield path, name, f"= {default}" if _picks(hint) else default, text
        inner += [(f"{path}.{name}".strip("."), sub) for sub in _tables_in(hint)]
    for place in inner:
        if place not in seen:
            seen.add(place)
            yield from keys(place[1], place[0], seen)


def _picks(hint: Any) -> bool:
    """Whether a key is there to pick its table among several: it may be one word only."""
    return get_origin(hint) is Literal and len(get_args(hint)) == 1


def _default(table: Any, name: str) -> tuple[str, str]:
    """A key's default, and what it means: its own text, its words, or what its table says."""
    if issubclass(table, BaseModel):
        field = table.model_fields[name]
        value = ... if field.is_required() else field.get_default(call_default_factory=True)
        text = field.description or ""
    else:
        value = table._field_defaults.get(name, ...)
        text = parameter_texts(table).get(name, "")
    (_, hint), *others = _members(_hints(table)[name])
    words = get_args(hint) if get_origin(hint) is Literal and not others else ()
    if len(words) > 1:
        text = f"{text} ({', '.join(words)})".strip()
    text = text or summary(table)
    if value is ...:
        return "required", text
    simple = isinstance(value, (str, int, float, bool))
    return (json.dumps(value) if simple else ""), text


def _hints(declaration: Any) -> dict[str, Any]:
    if not isinstance(declaration, type):
        return {}
    if issubclass(declaration, BaseModel):
        hints = get_type_hints(declaration, include_extras=True)
        return {name: hints[name] for name in declaration.model_fields}
    if hasattr(declaration, "_fields"):
        return get_type_hints(declaration, include_extras=True)
    return {}


def _members(hint: Any) -> list[tuple[str | None, Any]]:
    """The declarations that a type allows, each with its tag; behind a tag there may be more to choose."""
    if get_origin(hint) is Annotated:
        inner, *notes = get_args(hint)
        for k, note in enumerate(notes):
            if isinstance(note, Tag):
                others = (*notes[:k], *notes[k + 1 :])
                return [(note.tag, Annotated[(inner, *others)] if others else inner)]
        return _members(inner)
    if get_origin(hint) in (Union, types.UnionType):
        return [pair for member in get_args(hint) for pair in _members(member)]
    return [(None, hint)]


def _tables_in(hint: Any) -> list[Any]:
    found: list[Any] = []
    for tag, member in _members(hint):
        if _hints(member):
            found.append(member)
        elif tag is not None:
            found += _tables_in(member)
        elif get_origin(member) in (list, tuple):
            found += [table for item in get_args(member) for table in _tables_in(item)]
    return found


def _step(hint: Any, part: object) -> list[Any]:
    """The declarations behind one part of an error's location."""
    members = _members(hint)
    tagged = [member for tag, member in members if tag == part]
    if tagged:
        return tagged
    found: list[Any] = []
    for _, member in members:
        if isinstance(part, str) and part in _hints(member):
            found.append(_hints(member)[part])
        elif isinstance(part, int) and get_origin(member) in (list, tuple):
            found += get_args(member)[:1]
    return found


def _declared(root: Any, loc: tuple) -> list[Any]:
    found = [root]
    for part in loc:
        found = [hint for before in found for hint in _step(before, part)]
    return found


def _allowed_keys(root: Any, loc: tuple) -> list[str]:
    return [
        name
        for hint in _declared(root, loc)
        for _, member in _members(hint)
        for name in _hints(member)
    ]


# ---- files ------------------------------------------------------------------------------------


def read_text(path: Path) -> str:
    """The text of a scene file; InputError if it cannot be read, or is a pipe, which may never end."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError(f"{path}: is no regular file; save what comes from there in one")
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, not a scene file") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8 ({error.reason})") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def parse(text: str, name: str, yaml: bool = False) -> dict[str, Any]:
    """The tables of a TOML or YAML text; InputError with the line where its grammar fails."""
    if yaml:
        return _parse_yaml(text, name)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{name}: not valid TOML: {error}") from None


def _parse_yaml(text: str, name: str) -> dict[str, Any]:
    import yaml

    class Loader(yaml.SafeLoader):
        def construct_mapping(self, node: Any, deep: bool = False) -> dict:
            seen: set[object] = set()
            for key_node, _ in node.value:
                key = self.construct_object(key_node, deep=True)
                if key in seen:
                    line = key_node.start_mark.line + 1
                    raise InputError(f"{name}: the key {key!r} stands twice (line {line})")
                seen.add(key)
            return super().construct_mapping(node, deep)

    # YAML 1.1 reads 1e7 as text; people who write it mean the number
    number = re.compile(r"^[-+]?(\d[\d_]*)(\.\d*)?[eE][-+]?\d+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+0123456789"))
    try:
        tables = yaml.load(text, Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f" (at line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise InputError(f"{name}: not valid YAML: {error.problem}{where}") from None
    except yaml.YAMLError as error:
        raise InputError(f"{name}: not valid YAML: {' '.join(str(error).split())}") from None
    if tables is None:
        return {}
    if not isinstance(tables, dict) or not all(isinstance(key, str) for key in tables):
        raise InputError(f"{name}: must be tables of keys and values, as in a packaged scene")
    return tables


# ---- overrides --------------------------------------------------------------------------------


def parse_override(text: str) -> Override:
    """`table.key=value`: the value is TOML, and a bare word is text."""
    path, equals, value_text = text.partition("=")
    parts = tuple(part.strip() for part in path.split("."))
    if not equals or not all(parts):
        raise InputError(f"--set {text}: must be table.key=value, as in --set time.duration=3600")
    value_text = value_text.strip()
    try:
        value = tomllib.loads(f"value = {value_text}")["value"]
    except tomllib.TOMLDecodeError as error:
        if not value_text or value_text[0] in "\"'[{":
            raise InputError(f"--set {text}: the value is not valid TOML: {error}") from None
        value = value_text
    return Override(parts, value, text)


def apply_override(
    tables: dict[str, Any], override: Override, words: dict[str, tuple[str, Collection[str]]]
) -> None:
    """Put the value of an override into the tables, in place.

    A part of the path may be the number of a table in a list of tables, counted from 1; where there is
    only one, the number may be left out.  `words` names the tables that may stand as a single word, with the
    key at which that word stands when the table is written out, and the words that stand for a table.
    """
    node: Any = tables
    for depth, part in enumerate(override.keys[:-1]):
        place = ".".join(override.keys[: depth + 1])
        if part.isdecimal() and isinstance(node, dict):
            raise InputError(f"--set {override.text}: {place} is not a list, so it takes no number")
        if isinstance(node, dict):
            node = node.setdefault(part, {})
        else:
            node = node[_index(node, part, override)]
        if isinstance(node, list) and not override.keys[depth + 1].isdecimal():
            if len(node) != 1:
                raise InputError(
                    f"--set {override.text}: there are {len(node)} {place}, say which: "
                    f"{place}.1.{'.'.join(override.keys[depth + 1 :])}=…"
                )
            node = node[0]
        key, tabular = words.get(place, ("", ()))
        if isinstance(node, str) and node in tabular:
            node = tables[place] = {key: node}
        if not isinstance(node, (dict, list)):
            raise InputError(f"--set {override.text}: {place} is {node!r}, not a table of keys")
    last = override.keys[-1]
    node[last if isinstance(node, dict) else _index(node, last, override)] = override.value


def _index(node: list, part: str, override: Override) -> int:
    if not part.isdecimal() or not 1 <= int(part) <= len(node):
        raise InputError(f"--set {override.text}: {part!r} must be 1 to {len(node)}")
    return int(part) - 1


# ---- validation -------------------------------------------------------------------------------


def validate(
    declaration: Any,
    tables: dict[str, Any],
    name: str,
    overrides: tuple[Override, ...] = (),
) -> Any:
    """Tables as the declared type, or InputError that names the file, or the override that was wrong."""
    text = json.dumps(tables, default=str)
    try:
        return TypeAdapter(declaration).validate_json(text)
    except ValidationError as error:
        found = error.errors(include_url=False)
        raise InputError(_one_line(declaration, found, tables, name, overrides)) from None


def _one_line(
    declaration: Any, errors: list, tables: dict, name: str, overrides: tuple[Override, ...]
) -> str:
    by_path: dict[tuple, list] = {}
    for error in sorted(errors, key=lambda error: "extra" not in error["type"]):
        by_path.setdefault(_path(declaration, error, tables), []).append(error)
    path, first = next(iter(by_path.items()))
    rest = f" (and {len(by_path) - 1} more)" if len(by_path) > 1 else ""
    to_blame = _override_of(path, overrides)
    message = _message(declaration, first)
    if to_blame is None:
        return _place(path, tables, name) + message + rest
    if first[0]["type"] == "value_error":  # of several keys together
        return f"{_place(path, tables, name)}{message} (with --set {to_blame.text}){rest}"
    return f"--set {to_blame.text}: {_within(to_blame, path, tables)}{message}{rest}"


def _path(declaration: Any, error: Any, tables: Any) -> tuple:
    """Keys and indices of the user's own file; choices that pydantic made on the way are left out."""
    path: list[Any] = []
    node = tables
    loc = error["loc"]
    if error["type"].startswith("union_tag"):
        loc = (*loc, _key_of_choice(declaration, loc))
    for depth, part in enumerate(loc):
        known = (
            part in node
            if isinstance(node, dict)
            else isinstance(node, list) and isinstance(part, int) and part < len(node)
        )
        if known:
            path.append(part)
            node = node[part]
        elif (
            depth == len(loc) - 1
            and isinstance(node, dict)
            and error["type"].startswith(("missing", "union_tag"))
        ):
            path.append(part)
    return tuple(part for part in path if part != "")


def _key_of_choice(declaration: Any, loc: tuple) -> str:
    """The key whose word picks the table there."""
    parts = (part for hint in _declared(declaration, loc) for part in type_parts(hint))
    choices = (part.discriminator for part in parts if isinstance(part, Discriminator))
    return next((choice.key for choice in choices if isinstance(choice, ByKey)), "")


def _override_of(path: tuple, overrides: tuple[Override, ...]) -> Override | None:
    """The last override that put the value of a path there, or a value inside it."""
    names = tuple(part for part in path if not isinstance(part, int))
    numbers = [part + 1 for part in path if isinstance(part, int)]
    for override in reversed(overrides):
        own = override.names
        which = [int(part) for part in override.keys if part.isdecimal()]
        within = names[: len(own)] == own and numbers[-len(which) or len(numbers) :] == which
        around = len(own) > len(names) and own[: len(names)] == names
        if names and (within or around):
            return override
    return None


def _within(override: Override, path: tuple, tables: Any) -> str:
    """Of a value that is a table, or a list of such: the key in it, and what the key has."""
    inner = [part for part in path if not isinstance(part, int)][len(override.keys) :]
    if not inner:
        return ""
    value = _value(path, tables)
    return f"{'.'.join(inner)} " + (
        "" if value is None else f"= {json.dumps(value, default=str)}: "
    )


def _place(path: tuple, tables: Any, name: str) -> str:
    """File, table, key and value of a path, as a person would look for them."""
    table, key = _split(path, tables)
    where = f"{name}: [{_table_name(table, tables)}]" if table else f"{name}:"
    if not key:
        return f"{where} "
    if _value(path, tables) is None:
        return f"{where} {key} "
    value = json.dumps(_value(path, tables), default=str, ensure_ascii=False)
    if len(value) > 60:
        value = value[:57] + "..."
    return f"{where} {key} = {value}: "


def _table_name(path: tuple, tables: Any) -> str:
    name, node = "", tables
    for part in path:
        if not isinstance(part, int):
            name += f".{part}"
        elif len(node) > 1:  # the only table of a list needs no number
            name += f" number {part + 1}"
        node = node[part]
    return name.strip(".")


def _split(path: tuple, tables: Any) -> tuple[tuple, str]:
    """The table of a path and the key in it; a list of numbers belongs to its key."""
    if isinstance(_value(path, tables), dict):
        return path, ""
    depth = len(path)
    while depth and isinstance(path[depth - 1], int):
        depth -= 1
    key = "".join(f"[{part}]" if isinstance(part, int) else part for part in path[depth - 1 :])
    return path[: max(depth - 1, 0)], key


def _value(path: tuple, tables: Any) -> Any:
    node = tables
    for part in path:
        if isinstance(node, dict) and part not in node:
            return None
        node = node[part]
    return node


_TYPES = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be text in quotes",
    "bool_type": "must be true or false",
    "finite_number": "must be a finite number",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
}
_OUT_OF_BOUNDS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}


def _message(declaration: Any, errors: list) -> str:
    """What would be right; where several types are allowed, all of them."""
    messages = list(dict.fromkeys(_message_of(declaration, error) for error in errors))
    if all(message.startswith("must be ") for message in messages):
        return "must be " + ", or ".join(text.removeprefix("must be ") for text in messages)
    return messages[0]


def _missing(declaration: Any, loc: tuple) -> str:
    """What would be right where an entry of a list, or a key that must be given, is missing."""
    if isinstance(loc[-1], int):
        # of a choice between types pydantic's location names the type, too
        hints = _declared(declaration, loc[:-1]) or _declared(declaration, loc[:-2])
        for member in (member for hint in hints for _, member in _members(hint)):
            if get_origin(member) is tuple:
                return f"must be a list of {len(get_args(member))} entries"
        return "must be a table of keys"
    for hint in _declared(declaration, loc[:-1]):
        for _, member in _members(hint):
            if loc[-1] in _hints(member):
                return f"is missing: {_default(member, loc[-1])[1]}"
    return "is missing: "


def _message_of(declaration: Any, error: Any) -> str:
    kind, context, loc = error["type"], error.get("ctx", {}), error["loc"]
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        what = "table" if isinstance(error["input"], dict) else "key"
        return f"unknown {what}; {choose(loc[-1], _allowed_keys(declaration, loc[:-1]))}"
    if kind.startswith("missing"):
        return _missing(declaration, loc)
    if kind == "literal_error":
        return choose(error["input"], re.findall(r"'([^']*)'", context["expected"]))
    if kind.startswith("union_tag"):
        if not isinstance(error["input"], dict):
            return "must be a table of keys"
        hint = _declared(declaration, loc)[0]
        words = [str(tag).removeprefix("=") for tag, _ in _members(hint) if tag]
        word = context.get("tag", "").removeprefix("=")
        return ("" if word else "is missing; ") + choose(word, words)
    if kind in _OUT_OF_BOUNDS:
        relation, name = _OUT_OF_BOUNDS[kind]
        return f"must be {relation} {context[name]:g}"
    if kind in ("too_long", "too_short"):
        bound = context.get("max_length", context.get("min_length"))
        few = "at least " * (kind == "too_short")
        return f"must be a list of {few}{bound} entries"
    if kind in ("model_type", "model_attributes_type", "named_tuple_type", "dict_type"):
        return "must be a table of keys"
    if kind == "value_error":
        return str(context["error"])
    return _TYPES.get(kind, error["msg"])
