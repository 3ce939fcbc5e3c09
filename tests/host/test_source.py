"""Include expansion: what a preprocessor would do, with marks that point back at the files."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cases import for_each

from clrender.device.compiler import first_errors
from clrender.device.source import expand, load_source
from clrender.errors import RenderError
from clrender.files.kernel_hash import kernels_sha256
from clrender.files.package_data import kernels_folder


def write(root: Path, **files: str) -> None:
    """Files by name, with __ for / and the last _ for the dot."""
    for name, text in files.items():
        stem, _, ending = name.rpartition("_")
        path = root / f"{stem.replace('__', '/')}.{ending}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def guarded(name: str, body: str) -> str:
    return f"// For a test.\n#ifndef {name}\n#define {name}\n{body}\n#endif\n"


def places(text: str) -> dict[str, str]:
    """Where each line that holds `mark_…` says it comes from, as ``file:line``."""
    found = {}
    name, number = "", 0
    for line in text.splitlines():
        if line.startswith("#line "):
            _, after, quoted = line.split(" ", 2)
            name, number = quoted.strip('"'), int(after) - 1
            continue
        number += 1
        if "mark_" in line:
            found[line.strip()] = f"{name}:{number}"
    return found


def test_lines_are_marked_with_the_file_they_come_from(tmp_path: Path) -> None:
    write(
        tmp_path,
        a_cl='mark_1\n#include "room/b.h"\nmark_2\n',
        room__b_h=guarded("ROOM_B_H", 'mark_3\n#include "room/c.h"\nmark_4'),
        room__c_h=guarded("ROOM_C_H", "\n\nmark_5"),
    )
    assert places(expand("a.cl", tmp_path)) == {
        "mark_1": "a.cl:1",
        "mark_2": "a.cl:3",
        "mark_3": "room/b.h:4",
        "mark_4": "room/b.h:6",
        "mark_5": "room/c.h:6",
    }


def test_a_guarded_header_is_taken_in_once(tmp_path: Path) -> None:
    write(
        tmp_path,
        a_cl='#include "b.h"\n#include "c.h"\n#include "b.h"\n',
        b_h=guarded("B_H", "mark_b"),
        c_h=guarded("C_H", '#include "b.h"\nmark_c'),
    )
    text = expand("a.cl", tmp_path)
    assert text.count("mark_b") == 1
    assert "#include" not in text


def test_a_header_of_an_untaken_branch_is_still_there_for_the_others(tmp_path: Path) -> None:
    write(
        tmp_path,
        a_cl='#if LANES == 1\n#include "b.h"\n#else\n#include "c.h"\n#endif\n#include "b.h"\n#include "b.h"\n',
        b_h=guarded("B_H", "mark_b"),
        c_h=guarded("C_H", '#include "b.h"'),
    )
    # Once in each branch and once after: which of them counts is for the guard to say. The last is surely idle.
    assert expand("a.cl", tmp_path).count("mark_b") == 3


def test_text_without_a_guard_is_taken_in_each_time(tmp_path: Path) -> None:
    write(tmp_path, a_cl='#define X 1\n#include "b.inc"\n#undef X\n#include "b.inc"\n', b_inc="mark_b\n")
    assert expand("a.cl", tmp_path).count("mark_b") == 2


def test_includes_in_comments_are_no_includes(tmp_path: Path) -> None:
    write(
        tmp_path, a_cl='// #include "x.h"\n/* now\n#include "y.h"\n*/\n  #  include "b.h" // really\n', b_h="mark_b\n"
    )
    assert places(expand("a.cl", tmp_path)) == {"mark_b": "b.h:1"}


def test_a_folder_with_blanks_and_an_entry_elsewhere(tmp_path: Path) -> None:
    root = tmp_path / "with blanks"
    write(root, b_h=guarded("B_H", "mark_b"))
    entry = tmp_path / "elsewhere.cl"
    entry.write_text('#include "b.h"\nmark_a\n')
    assert places(expand(str(entry), root)) == {"mark_b": "b.h:4", "mark_a": f"{entry}:2"}


@for_each(
    ("text", "message"),
    [
        ('#include "rom/b.h"\n', r'a\.cl:1: kernel file "rom/b\.h" is not in .*; did you mean "room/b\.h"\?'),
        ("\n#include <b.h>\n", r"a\.cl:2: includes are quoted"),
        ('#include "../b.h"\n', r'a\.cl:1: "\.\./b\.h" leaves the kernels folder'),
        ('#include "a.cl"\n', r"includes form a cycle \(a\.cl:1 -> a\.cl\)"),
        ('#include "room/b.h"\n', r"includes form a cycle \(room/b\.h:4 -> c\.h:4 -> room/b\.h\)"),
        ('#include "bytes.h"\n', r'"bytes\.h" cannot be read'),
    ],
)
def test_faults_name_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    write(
        tmp_path,
        a_cl=text,
        room__b_h=guarded("ROOM_B_H", '#include "c.h"'),
        c_h=guarded("C_H", '#include "room/b.h"'),
    )
    (tmp_path / "bytes.h").write_bytes(b"\xff\xfe")
    with pytest.raises(RenderError, match=message):
        expand("a.cl", tmp_path)


def test_definitions_come_first_and_change_the_hash(tmp_path: Path) -> None:
    write(tmp_path, a_cl="mark_a\n")
    one = load_source("a.cl", {"LANES": 1, "EYES": "two words"}, tmp_path)
    two = load_source("a.cl", {"LANES": 2, "EYES": "two words"}, tmp_path)
    assert one.text.startswith("#pragma OPENCL FP_CONTRACT OFF\n#define EYES two words\n#define LANES 1\n#line 1")
    assert one.sha256 != two.sha256


def test_the_hash_of_the_kernels_sees_names_and_contents(tmp_path: Path) -> None:
    write(tmp_path, a_cl='#include "room/b.h"\n', room__b_h='  # include "c.h"\n', c_h="1", d_cl="")
    first = kernels_sha256(tmp_path)
    (tmp_path / "d.cl").rename(tmp_path / "e.cl")
    second = kernels_sha256(tmp_path)
    (tmp_path / "c.h").write_text("2")
    third = kernels_sha256(tmp_path)
    assert len({first, second, third}) == 3
    write(tmp_path, old_h="3", room__older_h='#include "old.h"\n')
    assert kernels_sha256(tmp_path) == third, "headers that nothing includes do not matter"


def test_every_kernel_file_is_in_the_hash(tmp_path: Path) -> None:
    """A change of any of them gives another hash: none is there that no entry point includes."""
    shutil.copytree(kernels_folder(), tmp_path / "kernels")
    folder, found = tmp_path / "kernels", set()
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        before = path.read_bytes()
        path.write_bytes(before + b"\n")
        found.add(kernels_sha256(folder))
        path.write_bytes(before)
    assert len(found) == sum(path.is_file() for path in folder.rglob("*"))
    assert kernels_sha256(folder) == kernels_sha256() not in found


def test_every_entry_point_of_the_tree_expands() -> None:
    from clrender.files.package_data import kernels_folder

    entries = sorted(kernels_folder().rglob("*.cl"))
    assert entries
    for entry in entries:
        assert "#include" not in expand(entry.relative_to(kernels_folder()).as_posix())


def test_places_of_a_compiler_that_passes_over_line_directives(tmp_path: Path) -> None:
    (tmp_path / "first.h").write_text("float one;\nfloat two;\n")
    (tmp_path / "main.cl").write_text('int zero;\n#include "first.h"\nint three;\nint four;\n')
    source = load_source("main.cl", {"LANES": 1}, tmp_path)
    lines = source.text.splitlines()
    for text, place in {"zero": "main.cl:1", "one": "first.h:1", "two": "first.h:2", "four": "main.cl:4"}.items():
        number = next(at for at, line in enumerate(lines, 1) if text in line)
        assert source.place(number) == place
        log = f"<kernel>:{number}:5: error: use of undeclared identifier\nmain.cl:7:1: error: another"
        told = f"{place}:5: error: use of undeclared identifier | main.cl:7:1: error: another"
        assert first_errors(log, source) == told
