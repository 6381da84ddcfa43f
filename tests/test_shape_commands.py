"""`eigenbench shapes list`, `show` and `export` as a user runs them."""

import json
import os
import re
import sys

import pytest
from PIL import Image as PillowImage
from test_cli import fails, run

from eigenbench.generators.selection import open_source

PARTS = ["object", "environment", "mug"]


def test_list_show_export(tmp_path):
    """The three commands as typed, in a folder of one's own."""
    rows = json.loads(run("shapes", "list", "--json").stdout)
    assert rows == open_source("default").rows()
    assert {r["role"] for r in rows} <= set(PARTS)
    text = run("shapes", "list").stdout
    assert all(r["category"] in text for r in rows)
    done = run("shapes", "show", "can", "--count", 3, "--measures", "--cutaway", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("can.png: 600 x ")
    assert "drawing: 3 of 3" in done.stderr
    done = run("shapes", "show", "mug", "--role", "object", "--index", 2, "--out", "new/mug.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with PillowImage.open(tmp_path / "new" / "mug.png") as picture:
        assert picture.size[0] == 960
    done = run("shapes", "export", "x", "--category", "bottle", "--split", "train", "--format", "glb", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("x: 16 shapes of 1 categories, ")
    out = json.loads(run("shapes", "export", "x", "--category", "bucket", "--json", cwd=tmp_path).stdout)
    assert (out["folder"], out["shapes"], out["refused"]) == ("x", 33, {})


def test_category_is_argument_or_option(mesh_folder, tmp_path):
    """All commands take `--category`; `show` and `measure` take it as argument too, and `export` a format in any case."""
    source = ("--shapes", f"meshes={mesh_folder}")
    for how in (["can"], ["--category", "can"], ["can", "--category", "can"]):
        done = run("shapes", "show", *how, *source, cwd=tmp_path)
        assert done.stdout.startswith("can.png: "), done.stderr
        done = run("shapes", "measure", *how, *source, "--workers", 1, "--json")
        assert [s["category"] for s in json.loads(done.stdout)["shapes"]] == ["can"]
    done = run("shapes", "export", "x", "--category", "can", "--format", "GLB", *source, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "x" / "train" / "object" / "can").glob("*.glb"))) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="such names cannot be there")
def test_names_stay_on_their_line(mesh_folder):
    """Line breaks, terminal codes and bytes that are no text in a file name are printed as escapes."""
    names = {"a\nb.obj": r"a\nb.obj", "\x1b[2Jc.obj": r"\x1b[2Jc.obj", os.fsdecode(b"\xff.obj"): r"\udcff.obj"}
    for name in names:
        (mesh_folder / "jar" / name).write_text("v 0 0 0\n")
    source = ("--shapes", f"meshes={mesh_folder}")
    for command in (["list"], ["measure", "--workers", 1]):
        lines = run("shapes", *command, *source).stdout.splitlines()
        for shown in names.values():
            assert sum(f"not used: jar/{shown}: " in line for line in lines) == 1
        assert all(line.isprintable() for line in lines)
    (mesh_folder / "jar" / "jar.obj").unlink()
    fails(r"3 refused: jar/.*\\x1b", "generate", "--task", "tube", "--split", "test", *source)


def test_refused_shapes_are_exported_with_the_rest(mesh_folder, tmp_path):
    """`export --json` names the refused shapes of a split that has no other ones."""
    (mesh_folder / "jar" / "jar.obj").write_text("v 0 0 0\n")
    done = run("shapes", "export", tmp_path / "x", "--shapes", f"meshes={mesh_folder}", "--json")
    assert list(json.loads(done.stdout)["refused"]) == ["jar/jar.obj"]


def test_meshes_are_listed_shown_and_exported(mesh_folder, tmp_path):
    """A user's folder works like the library; what cannot be used is named."""
    (mesh_folder / "box" / "bad.obj").write_text("v 0 0 0\n")
    source = f"meshes={mesh_folder}"
    listed = run("shapes", "list", "--shapes", source)
    assert "box/bad.obj" in listed.stdout
    rows = json.loads(run("shapes", "list", "--shapes", source, "--json").stdout)
    assert {(r["category"], r["split"], r["count"]) for r in rows if r["role"] == "object"} == {
        ("box", "train", 1),
        ("can", "train", 1),
        ("jar", "test", 1),
    }
    assert "box/bad.obj" in run("shapes", "show", "--shapes", source, "--out", tmp_path / "s.png").stdout
    assert run("shapes", "export", tmp_path / "x", "--shapes", source).returncode == 0
    assert (tmp_path / "x" / "train" / "object" / "box" / "cube.obj").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["list", "--shapes", "mesh=x"], "Shape source 'mesh=x' is not known"),
        (["list", "--shapes", "meshes=nowhere"], "Shape folder nowhere does not exist"),
        (["show", "bottel"], "Unknown category 'bottel'. Did you mean 'bottle'"),
        (["show", "--role", "objects"], "Unknown role 'objects'. Did you mean 'object'"),
        (["show", "--split", "tets"], "Unknown split 'tets'. Did you mean 'test'"),
        (["show", "bottle", "--split", "test"], "no shape of category bottle, split test; `eigenbench shapes list`"),
        (["show", "bottle", "--index", "16"], "Index 16 is out of range: object bottle has the indices 0 to 15"),
        (["show", "bottle", "--index", "-1"], "Index -1 is out of range"),
        (["show", "bottle", "--index", "two"], "Invalid value for '--index'"),
        (["show", "--index", "1"], "An index needs one role and category"),
        (["show", "bottle", "--count", "0"], "Number of shapes is 0"),
        (["show", "bottle", "--out", "bottle.jpg"], "Picture bottle.jpg does not end in .png"),
        (["show", "bottle", "--out", "file/b.png"], "Picture file/b.png cannot be written: "),
        (["show", "can", "--category", "bottle"], "Category is 'can' as argument, but --category is 'bottle'"),
        (["measure", "can", "--category", "bottle"], "Category is 'can' as argument, but --category is 'bottle'"),
        (["measure", "can", "--out", "none/x.md"], r"Table none/x.md cannot be written: No such file .* \(none\)"),
        (["measure", "can", "--out", "file/x.md"], "Table file/x.md cannot be written: Not a directory"),
        (["measure", "can", "--out", "."], r"Table \. is a folder"),
        (["export"], "Missing argument 'out'"),
        (["export", "out", "--format", "objs"], "Unknown format 'objs'. Did you mean 'obj'"),
        (["export", "out", "--category", "kettel"], "Unknown category 'kettel'"),
        (["export", "file"], "file is not a folder"),
        (["export", "file/out"], "Folder file/out cannot be written: "),
        (["export", "."], r"Folder \. holds 1 files that no export wrote, file first"),
        (["shwo"], "No such command 'shwo'"),
    ],
)
def test_bad_input(tmp_path, arguments, message):
    """Each fault of an argument: one line, code 2, nothing written."""
    (tmp_path / "file").touch()
    arguments = [*arguments, "--count", 1] if "file/b.png" in arguments else arguments
    done = run("shapes", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    errors = [line for line in done.stderr.splitlines() if not line.startswith("drawing: ")]
    assert len(errors) == 1, done.stderr
    assert errors[0].startswith("error: ")
    assert re.search(message, errors[0]), errors[0]
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="permissions do not bind here")
def test_folder_without_permission(tmp_path):
    """A folder that may not be written to is named, with the way out."""
    tmp_path.chmod(0o500)
    fails("cannot be written", "shapes", "export", tmp_path / "x", "--category", "bottle")
