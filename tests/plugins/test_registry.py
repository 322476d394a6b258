"""The table of adapters: every door in, the rule of choice, and every way in which a plug-in can be wrong."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

import topokit as tk
from topokit.errors import AdapterError, AdapterWarning, InputError, MissingDependencyError, UnknownFormatError
from topokit.plugins import foreign_code, registry
from topokit.testing import icosphere, sphere_samples

POINTS = sphere_samples(60).points
BUILT_IN = list(registry.BUILT_IN)
MODULE = """
import topokit

class Blobs(topokit.Adapter):
    name = "blobs"
    description = "blobs for a test"
    suffixes = (".blob",)

    def open(self, source, n_samples=60):
        from topokit.testing import icosphere, sphere_samples
        return topokit.Shape(topokit.SurfaceSamples(sphere_samples(n_samples).points))
"""


@pytest.fixture(autouse=True)
def own_registry(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Each test begins with the built-in adapters and no installed plug-in."""
    monkeypatch.setattr(registry, "_registered", dict(registry.BUILT_IN))
    monkeypatch.setattr(registry, "entry_points", list)
    tk.refresh_adapters()
    yield
    tk.refresh_adapters()


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Writes a module, and on demand the metadata that an installed distribution would have."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    written: list[str] = []

    def write(module: str, code: str, name: str = "", distribution: str = "", target: str = "") -> None:
        (folder / f"{module}.py").write_text(code)
        written.append(module)
        if name:
            info = folder / f"{(distribution or module).replace('-', '_')}-1.0.dist-info"
            info.mkdir()
            (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution or module}\nVersion: 1.0\n")
            (info / "entry_points.txt").write_text(f"[topokit.adapters]\n{name} = {target or module + ':Blobs'}\n")
            monkeypatch.setattr(registry, "entry_points", foreign_code.entry_points)

    yield write
    for module in written:
        sys.modules.pop(module, None)


@pytest.fixture
def blob(tmp_path: Path) -> Path:
    path = tmp_path / "one.blob"
    path.write_bytes(b"BLOB and more")
    return path


def shape(**changed: Any) -> tk.Shape:
    return tk.Shape(tk.SurfaceSamples(**{"points": POINTS, **changed}))


def make(name: str, *, content: bool | Exception = False, **attributes: Any) -> None:
    """Register an adapter called `name`, whose shape is called so too."""

    def can_open(source: Path) -> bool:
        if isinstance(content, Exception):
            raise content
        return content and source.suffix != ".obj"

    def opener(source: object) -> tk.Shape:
        return tk.Shape(tk.SurfaceSamples(POINTS), name=name)

    tk.register_adapter(
        name, opener, **{"description": name, "suffixes": (".blob",), "can_open": can_open, **attributes}
    )


def message(kind: type[Exception], source: object, **options: Any) -> str:
    with pytest.raises(kind) as caught:
        tk.load(source, **options)
    return str(caught.value)


# the doors in


def test_a_string_is_imported_on_the_first_look_up(plugin: Any, blob: Path) -> None:
    plugin("lazy_blobs", MODULE)
    tk.register_adapter("blobs", "lazy_blobs:Blobs")
    assert "lazy_blobs" not in sys.modules
    assert tk.load(blob).name == "one.blob"
    assert "lazy_blobs" in sys.modules


def test_a_string_with_attributes_is_a_function_and_imported_when_it_opens(plugin: Any, blob: Path) -> None:
    plugin("lazy_function", MODULE + "\ndef open_blobs(source):\n    return Blobs().open(source)\n")
    tk.register_adapter("blobs", "lazy_function:open_blobs", description="blobs", suffixes=(".blob",))
    assert [row.suffixes for row in tk.list_adapters() if row.name == "blobs"] == [(".blob",)]
    assert "lazy_function" not in sys.modules
    assert tk.load(blob).samples.n_points == 60


def test_entry_points_are_found_on_the_first_look_up_and_take_options(plugin: Any, blob: Path) -> None:
    plugin("installed_blobs", MODULE, name="blobs")
    assert tk.load(blob, n_samples=70, n_neighbors=9).samples.n_points == 70
    assert tk.load(blob, adapter="blobs").n_neighbors is None
    assert [row.name for row in tk.list_adapters()] == [*BUILT_IN, "blobs"]


def test_a_class_may_be_decorated_and_an_entry_point_at_once(plugin: Any, blob: Path) -> None:
    plugin("twice", MODULE.replace("class Blobs", "@topokit.register_adapter\nclass Blobs"), name="blobs")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert tk.load(blob).samples.n_points == 60


def test_a_plug_in_may_register_more_than_its_entry_point(plugin: Any, blob: Path) -> None:
    more = "\n@topokit.register_adapter\nclass More(Blobs):\n    name = 'more'\n    suffixes = ('.one.blob',)\n"
    plugin("several", MODULE + more, name="blobs", target="several:Blobs [all]")
    assert [row.name for row in tk.list_adapters()] == [*BUILT_IN, "blobs", "more"]


def test_decorators_for_functions_and_classes(blob: Path) -> None:
    for _ in range(2):  # a notebook's cell is run again

        @tk.register_adapter("dots", suffixes=(".dots",), can_open=lambda path: path.read_bytes().startswith(b"BLOB"))
        def dots(source: Path, n_samples: int = 60) -> tk.Shape:
            """Dots in a file.

            More about them.
            """
            return shape()

        @tk.register_adapter
        class Blobs(tk.Adapter):
            name, description, suffixes = "blobs", "blobs", (".blob2",)
            opener = staticmethod(dots)

    assert callable(dots)
    assert [(row.name, row.description) for row in tk.list_adapters()][-2:] == [
        ("dots", "Dots in a file."),
        ("blobs", "blobs"),
    ]
    assert tk.load(blob).name == "one.blob"
    assert tk.load(blob.rename(blob.with_suffix(".blob2")), adapter="blobs").samples.n_points == 60


def test_suffixes_that_need_more_are_listed_with_it() -> None:
    make("one", suffixes=(".a", ".b"), suffix_requires=((".b", "nothing_b"), (".b", "sys"), (".a", "os")))
    make("two", suffixes=(".c",), requires=("nothing_c", "nothing_d"))
    one, two = tk.list_adapters()[-2:]
    assert (one.usable, one.missing_suffixes, one.state) == (True, (".b",), "usable; for .b: pip install nothing_b")
    assert (two.usable, two.missing_suffixes, two.state) == (False, (".c",), "pip install nothing_c nothing_d")


def test_the_view_is_read_only() -> None:
    first = tk.list_adapters()[0]
    with pytest.raises(AttributeError):
        first.usable = False  # type: ignore[misc]
    assert isinstance(tk.list_adapters(), tuple)


def test_listing_imports_neither_torch_nor_numpy() -> None:
    code = (
        "import topokit, sys; topokit.list_adapters(); print(*{'torch', 'numpy', 'scipy', 'trimesh'} & {*sys.modules})"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""


def test_importing_topokit_imports_no_plug_in(plugin: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for index in range(10):
        plugin(f"blobs_{index}", MODULE.replace('"blobs"', f'"blobs{index}"'), name=f"blobs{index}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    code = (
        "import sys, topokit; topokit.load; print(any(name.startswith('blobs_') for name in sys.modules)); "
        "print(len(topokit.list_adapters()), 'blobs_9' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[0] == "False"
    assert int(found.stdout.split()[1]) >= 10 + len(BUILT_IN)
    assert found.stdout.split()[2] == "True"


def test_a_plug_in_installed_after_the_first_look_up_is_found_after_a_refresh(plugin: Any, blob: Path) -> None:
    assert [row.name for row in tk.list_adapters()] == BUILT_IN
    plugin("late", MODULE, name="blobs")
    assert "'.blob' is not a known format" in message(UnknownFormatError, blob)
    tk.refresh_adapters()
    assert tk.load(blob).samples.n_points == 60
    assert [row.name for row in tk.list_adapters()] == [*BUILT_IN, "blobs"]


def test_a_broken_plug_in_is_tried_again_after_a_refresh(plugin: Any, blob: Path) -> None:
    plugin("mended", "import nothing_of_the_kind", name="blobs")
    with pytest.warns(AdapterWarning, match="is left out"):
        message(UnknownFormatError, blob)
    plugin("mended", MODULE + "\n# mended")
    tk.refresh_adapters()
    assert tk.load(blob).samples.n_points == 60


def test_what_is_registered_stays_after_a_refresh(blob: Path) -> None:
    make("kept")
    tk.refresh_adapters()
    assert tk.load(blob).name == "kept"


# clashes


def test_a_name_that_an_installed_plug_in_has(plugin: Any, blob: Path) -> None:
    plugin("blobs_a", MODULE, name="blobs")
    with pytest.raises(InputError, match=r"^adapter 'blobs' is registered already, by blobs_a:Blobs; "):
        make("blobs")
    make("blobs", overwrite=True)
    assert tk.load(blob).name == "blobs"


def test_a_name_that_is_taken() -> None:
    with pytest.raises(InputError) as caught:
        make("mesh")
    assert str(caught.value) == (
        f"adapter 'mesh' is registered already, by topokit.adapters.mesh.entry:MESH; {__name__}:make.<locals>.opener "
        "needs another name, or overwrite=True to replace it."
    )


def test_overwriting_a_name(blob: Path) -> None:
    make("mesh", overwrite=True, description="another")
    assert registry.adapter_for(blob).description == "another"
    tk.register_adapter("mesh", "topokit.adapters.mesh.entry:MESH", overwrite=True)
    assert message(UnknownFormatError, blob).startswith(f"{blob}: '.blob' is not a known format")


def test_plug_ins_whose_names_clash_are_left_out(plugin: Any, blob: Path) -> None:
    plugin("blobs_a", MODULE, name="blobs", distribution="blobs-a")
    plugin("blobs_b", MODULE, name="blobs", distribution="blobs-b")
    with pytest.warns(AdapterWarning) as caught:
        assert tk.load(blob).samples.n_points == 60
    assert [str(one.message) for one in caught] == [
        "A plug-in of blobs-b is left out: adapter 'blobs' is registered already, by blobs_a:Blobs; blobs_b:Blobs "
        "needs another name."
    ]


# broken plug-ins


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        (
            "import nothing_of_the_kind",
            "broken:Blobs could not be imported (ModuleNotFoundError: No module named 'nothing_of_the_kind').",
        ),
        ("class Own(Exception): ...\nraise Own('x')", "broken:Blobs could not be imported (Own: x)."),
        ("x = 1", "broken:Blobs could not be imported (AttributeError: module 'broken' has no attribute 'Blobs')."),
        ("def Blobs(): ...", "it is an object of type function; expected a subclass of topokit.Adapter."),
        ("class Blobs: ...", "it is the class Blobs; expected a subclass of topokit.Adapter."),
        (
            MODULE + "\n    def __init__(self, x): ...",
            "it cannot be made without arguments (TypeError: Blobs.__init__() missing 1 required positional argument: "
            "'x').",
        ),
        (
            MODULE.replace('"blobs"', '"bobs"'),
            "it is registered as 'blobs', but its name is 'bobs'; the two must agree.",
        ),
        (MODULE.replace("description", "describes"), "its description is None; expected a string."),
        (
            MODULE.replace('(".blob",)', '(".blob")'),
            "its suffixes are '.blob'; expected a tuple of lower-case strings with their dots, as ('.obj',).",
        ),
        (
            MODULE.replace('(".blob",)', '("Blob",)'),
            "its suffixes are ('Blob',); expected a tuple of lower-case strings with their dots, as ('.obj',).",
        ),
        (MODULE + "\n    types = 'a.B'", "its types are 'a.B'; expected a tuple of strings."),
        (MODULE + "\n    requires = ('a.b',)", "its requires are ('a.b',); expected top-level modules."),
        (
            MODULE + "\n    suffix_requires = ('.a', 'b')",
            "its suffix_requires are ('.a', 'b'); expected a tuple of pairs, as (('.3mf', 'lxml'),).",
        ),
        (MODULE + "\n    priority = '1'", "its priority is '1'; expected an integer."),
        (MODULE.replace("def open", "def opens"), "it has neither a method open() nor an opener."),
        (
            MODULE + "\n    opener = 5",
            "its opener is 5; expected a function, or its name as 'package.module:function'.",
        ),
        (MODULE + "\n    can_open = 3", "its can_open is 3; expected a function of the path."),
    ],
)
def test_a_broken_plug_in_is_one_warning_and_the_others_work(plugin: Any, blob: Path, code: str, problem: str) -> None:
    plugin("broken", code, name="blobs")
    make("works", content=True)
    with pytest.warns(AdapterWarning) as caught:
        names = [tk.load(blob).name for _ in range(3)]
    assert names == ["works"] * 3
    assert [str(one.message) for one in caught] == [f"adapter 'blobs' (broken:Blobs) is left out: {problem}"]
    row = next(row for row in tk.list_adapters() if row.name == "blobs")
    assert (row.usable, row.problem) == (False, problem)
    assert message(AdapterError, blob, adapter="blobs") == f"adapter 'blobs' (broken:Blobs) is broken: {problem}"


def test_two_lambdas_are_two() -> None:
    tk.register_adapter("short", lambda path: tk.Shape(tk.SurfaceSamples(POINTS)), suffixes=(".one",))
    with pytest.raises(InputError, match="adapter 'short' is registered already"):
        tk.register_adapter("short", lambda path: tk.Shape(tk.SurfaceSamples(POINTS)), suffixes=(".two",))
    assert tk.list_adapters()[-1].suffixes == (".one",)


def test_an_entry_point_that_names_nothing(plugin: Any, blob: Path) -> None:
    plugin("nameless", MODULE, name="blobs", target="nameless")
    problem = "it is given as 'nameless'; expected 'package.module:Class'."
    assert tk.list_adapters()[-1].problem == problem
    plugin("wordy", MODULE, name="words", target="no such: reference!")
    tk.refresh_adapters()
    assert str(tk.list_adapters()[-1].problem).startswith("no such: reference! could not be imported (")


def test_wrong_registrations_are_refused_at_once() -> None:
    with pytest.raises(AdapterError, match=r"^it is the class int; expected a subclass of topokit\.Adapter\.$"):
        tk.register_adapter("number", int)
    with pytest.raises(InputError, match=rf"^{__name__}:shape needs a name: register_adapter\(\"name\", \.\.\.\)\.$"):
        tk.register_adapter(suffixes=(".x",))(shape)
    with pytest.raises(InputError, match=r"is a class: suffixes must be attributes of it\.$"):
        tk.register_adapter("blobs", tk.Adapter, suffixes=(".x",))
    with pytest.raises(InputError, match=r"^adapter 'dots': an adapter has no suffix\. It has: name, description,"):
        tk.register_adapter("dots", shape, suffix=".x")


def test_a_look_that_fails_is_one_warning(blob: Path) -> None:
    make("nervous", content=RuntimeError("no idea"), suffixes=(".other",))
    make("calm", content=True)
    with pytest.warns(AdapterWarning) as caught:
        names = [tk.load(blob).name for _ in range(3)]
    assert names == ["calm"] * 3
    assert [str(one.message) for one in caught] == [
        f"adapter 'nervous' could not examine {blob} (RuntimeError: no idea). Only its suffixes are used."
    ]


def test_a_missing_dependency_is_named_with_what_to_install(blob: Path) -> None:
    make("needy", content=True, requires=("nothing_here", "sys"), extra="needy[all]>=2")
    needs = "'needy', which needs: pip install \"needy[all]>=2\""
    assert message(MissingDependencyError, blob) == f"The content of {blob} is recognized by {needs}"
    assert message(MissingDependencyError, blob, adapter="needy") == (
        "adapter 'needy' is not usable yet: pip install \"needy[all]>=2\""
    )
    row = tk.list_adapters()[-1]
    assert (row.usable, row.missing_suffixes, row.install) == (False, (".blob",), 'pip install "needy[all]>=2"')
    make("needy", requires=("nothing_here",), overwrite=True)
    assert message(MissingDependencyError, blob) == (
        f"The content of {blob} is not recognized, and its suffix is that of 'needy', which needs: "
        "pip install nothing_here"
    )
    make("ready")
    assert tk.load(blob).name == "ready"


# what an adapter returns


class Own(Exception):
    """An exception that no list of ours can name."""


def raising(error: Exception) -> Any:
    def opener(source: object) -> tk.Shape:
        raise error

    return opener


@pytest.mark.parametrize(
    ("opener", "kind", "expected"),
    [
        (
            lambda source: POINTS,
            AdapterError,
            "adapter 'blobs' could not open {}: it returned an object of type Tensor; a topokit.Shape was expected.",
        ),
        (
            lambda source: None,
            AdapterError,
            "adapter 'blobs' could not open {}: it returned an object of type NoneType; a topokit.Shape was expected.",
        ),
        (
            lambda source: shape(points=POINTS[:, :2]),
            InputError,
            "{} (adapter 'blobs'): points must have shape (..., N, 3), got (60, 2).",
        ),
        (
            lambda source: shape(normals=POINTS[1:]),
            InputError,
            "{} (adapter 'blobs'): normals must have shape (60, 3) to match the points, got (59, 3).",
        ),
        (
            lambda source: shape(points=POINTS * torch.tensor([1.0, torch.nan, 1.0])),
            InputError,
            "{} (adapter 'blobs'): points holds 60 values that are NaN or infinite; remove those rows first.",
        ),
        (
            lambda source: shape(points=POINTS[:5]),
            InputError,
            "{} (adapter 'blobs'): shape has 5 points, too few for 20 neighbors each: give at least 21.",
        ),
        (raising(KeyError("radius")), AdapterError, "adapter 'blobs' could not open {} (KeyError: 'radius')."),
        (raising(Own("halfway")), AdapterError, "adapter 'blobs' could not open {} (Own: halfway)."),
        (
            raising(ModuleNotFoundError("No module named 'blobs_c'")),
            MissingDependencyError,
            "adapter 'blobs' could not open {}: a package is missing (No module named 'blobs_c'); "
            'pip install "blobs[c]".',
        ),
        (raising(tk.TopokitError("its own words")), tk.TopokitError, "its own words"),
    ],
)
def test_what_an_adapter_returns_or_raises(blob: Path, opener: Any, kind: type[Exception], expected: str) -> None:
    tk.register_adapter("blobs", opener, description="blobs", suffixes=(".blob",), extra="blobs[c]")
    with pytest.raises(kind) as caught:
        tk.load(blob)
    assert str(caught.value) == expected.format(blob)
    assert type(caught.value) is kind
    assert (caught.value.__cause__ is None) == ("returned" in expected or "own words" in expected)


@pytest.mark.parametrize(
    "made",
    [
        lambda: tk.from_sdf(lambda x: x.norm(dim=1) - 0.7, bounds=((-1, -1, -1), (1, 1, 1))),
        lambda: tk.from_occupancy(lambda x: (5 * (0.7 - x.norm(dim=1))).sigmoid(), bounds=((-1, -1, -1), (1, 1, 1))),
        lambda: tk.from_mesh(icosphere(1)),
        lambda: tk.from_points(POINTS),
        lambda: tk.from_voxels(torch.ones(3, 3, 3, dtype=torch.bool)),
        lambda: tk.Shape(tk.SurfaceSamples(POINTS)),
    ],
)
def test_a_shape_that_a_plug_in_did_not_name_has_the_name_of_its_file(blob: Path, made: Any) -> None:
    tk.register_adapter(
        "blobs", lambda source: made(), description="blobs", suffixes=(".blob",), types=("builtins.set",)
    )
    assert tk.load(blob).name == "one.blob"
    assert tk.load(set()).name == made().name


def test_a_name_that_a_plug_in_gives_is_kept(blob: Path) -> None:
    make("own name")
    assert tk.load(blob).name == "own name"


def test_samples_that_are_made_later_are_checked_later(blob: Path) -> None:
    tk.register_adapter("blobs", lambda source: tk.Shape(lambda: POINTS), description="", suffixes=(".blob",))
    with pytest.raises(InputError, match=r"^samples must be a SurfaceSamples, got Tensor\.$"):
        tk.load(blob).euler()


def test_options_that_do_not_exist_are_named(blob: Path) -> None:
    tk.register_adapter("blobs", lambda source, radius=1, *, n_samples=9: shape(), suffixes=(".blob",), description="")
    assert message(InputError, blob, radios=2, seed=1) == (
        "adapter 'blobs' has no option 'radios', 'seed'. Did you mean radius? It has: n_neighbors, n_samples, radius."
    )
    tk.register_adapter("all", lambda source, **options: shape(), suffixes=(".all",), description="")
    assert tk.load(blob, adapter="all", anything=1).samples.n_points == 60
    assert tk.load(blob, n_neighbors=7).n_neighbors == 7


def test_openers_that_cannot_be_imported(plugin: Any, blob: Path) -> None:
    tk.register_adapter("later", "nowhere_at_all:function", suffixes=(".blob",), description="", extra="later")
    assert message(MissingDependencyError, blob) == (
        "the options of adapter 'later' could not be read: a package is missing (No module named 'nowhere_at_all'); "
        'pip install "later".'
    )
    tk.register_adapter("later", "math:cube", suffixes=(".blob",), description="", overwrite=True)
    assert message(AdapterError, blob) == (
        "the options of adapter 'later' could not be read (AttributeError: module 'math' has no attribute 'cube')."
    )


# the rule


def test_content_comes_before_suffix(blob: Path) -> None:
    make("suffix", priority=9)
    make("content", content=True, suffixes=())
    assert tk.load(blob).name == "content"


def test_among_those_that_recognize_the_content_the_suffix_decides_then_priority(blob: Path) -> None:
    make("high", content=True, suffixes=(), priority=9)
    make("low", content=True, priority=-1)
    assert tk.load(blob).name == "low"
    make("higher", content=True, priority=1)
    assert tk.load(blob).name == "higher"


def test_without_content_the_longest_suffix_decides_then_priority(blob: Path) -> None:
    make("short", priority=9)
    make("long", suffixes=(".gz", ".one.blob"))
    long = blob.rename(blob.with_name("THE.ONE.Blob"))
    assert tk.load(long).name == "long"
    make("longer", suffixes=(".one.blob",), priority=1)
    assert tk.load(long).name == "longer"


def test_the_name_comes_first(blob: Path) -> None:
    make("content", content=True)
    make("other", suffixes=())
    assert tk.load(blob, adapter="other").name == "other"


@pytest.mark.parametrize(
    ("content", "lead"),
    [(True, "is recognized by"), (False, "is not recognized, and its suffix is that of")],
)
def test_a_tie_that_is_left_names_both(blob: Path, content: bool, lead: str) -> None:
    make("one", content=content)
    make("two", content=content)
    assert message(InputError, blob) == (
        f"The content of {blob} {lead} the adapters 'one' and 'two', which rank equally: "
        "pass adapter='one' or adapter='two'."
    )


def test_unknown_files_learn_what_is_known_what_is_not_installed_and_how_to_write_one(tmp_path: Path) -> None:
    make("needy", requires=("nothing_here",), extra="topokit-needy")
    path = tmp_path / "what.xyz2"
    path.write_bytes(b"1 2 3\n")
    known = sorted({suffix for row in tk.list_adapters() for suffix in row.suffixes})
    of_files = [name for name in [*BUILT_IN, "needy"] if name != "open3d"]
    lacking = [row for row in tk.list_adapters() if row.install]
    assert lacking[-1].install == 'pip install "topokit-needy"'
    parts = (f"{' '.join(row.missing_suffixes) or row.name} ({row.install})" for row in lacking)
    assert message(UnknownFormatError, path) == (
        f"{path}: '.xyz2' is not a known format, and its content is not one either. Known: {', '.join(known)}. "
        f"Known, but not installed: {', '.join(parts)}. "
        f"If you know what it is, pass adapter=…, one of {', '.join(map(repr, of_files))}. For a format of your own "
        "write an adapter: help(topokit.Adapter) shows how."
    )


@pytest.mark.parametrize(
    ("name", "hint"), [("part.STEP", "STL"), ("a.blend", "STL"), ("a.vtp", "PyVista"), ("slice.PNG", "one .tif")]
)
def test_formats_of_other_programs_are_answered_in_a_line(name: str, hint: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"1 2 3\n")
    found = message(UnknownFormatError, tmp_path / name)
    assert hint in found
    assert len(found) - len(str(tmp_path)) < 150


def test_a_file_without_suffix_is_not_quoted_as_one(tmp_path: Path) -> None:
    (tmp_path / "scan").write_bytes(b"1 2 3\n")
    assert message(UnknownFormatError, tmp_path / "scan").startswith(f"{tmp_path / 'scan'}: it has no suffix")


def test_folders_are_offered_to_adapters(tmp_path: Path) -> None:
    (tmp_path / "slices").mkdir()
    assert message(tk.TopokitError, tmp_path / "slices").endswith("or examine all of them with topokit.survey.")
    make("slices", content=True)
    assert tk.load(tmp_path / "slices").name == "slices"


def test_packed_files_are_to_be_unpacked(blob: Path) -> None:
    blob.write_bytes(b"PK\x03\x04 now another file")
    assert "zip archive" in message(UnknownFormatError, blob.rename(blob.with_suffix(".zip")))


# objects


def test_the_dictionary_of_a_splat_trainer_is_opened_as_splats() -> None:
    scene = {
        "means": POINTS,
        "scales": torch.full((60, 3), -3.0, dtype=torch.float64) - torch.tensor([0.0, 0.0, 3.0]),
        "quats": torch.ones(60, 4, dtype=torch.float64),
        "opacities": torch.full((60,), 4.0, dtype=torch.float64),
    }
    assert tk.load(scene, n_samples=200).samples.n_points == 200
    assert "the dictionary lacks quats" in message(InputError, {k: v for k, v in scene.items() if k != "quats"})


def test_objects_by_public_name_and_by_defining_module(monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=1)
    assert tk.load(mesh, n_samples=99).samples.n_points == 99
    make("mine", types=(f"{__name__}.Own",))
    assert tk.load(Own()).name == "mine"
    assert tk.load(type("Heir", (Own,), {})()).name == "mine"
    make("alias", types=("never_imported.Thing", "public_name.Thing"))
    monkeypatch.setitem(sys.modules, "public_name", type(sys)("public_name"))
    sys.modules["public_name"].Thing = Path  # type: ignore[attr-defined]
    make("paths are files", types=("pathlib.Path",))
    assert "does not exist" in message(tk.TopokitError, Path("nowhere"))
    assert "never_imported" not in sys.modules


def test_objects_that_two_adapters_accept() -> None:
    make("one", types=(f"{__name__}.Own",))
    make("two", types=(f"{__name__}.Own",))
    assert message(InputError, Own()) == (
        f"Objects of {__name__}.Own are opened by the adapters 'one' and 'two', which rank equally: "
        "pass adapter='one' or adapter='two'."
    )
    make("three", types=("builtins.Exception",), priority=1)
    assert tk.load(Own()).name == "three"


@pytest.mark.parametrize(
    ("source", "name"), [(POINTS, "torch.Tensor"), ([POINTS, POINTS], "builtins.list"), (len, "builtins.builtin_f")]
)
def test_objects_that_may_be_several_things_are_refused_with_the_function_to_call(source: object, name: str) -> None:
    said = message(InputError, source)
    assert said.startswith(f"load got {name}")
    assert "For arrays and tensors use topokit.from_points, from_mesh or from_voxels" in said
