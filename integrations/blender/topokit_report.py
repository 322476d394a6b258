"""A Blender add-on that reports on the selected mesh by the command `topokit`, and marks its handles by empties.

Install it under Edit > Preferences > Add-ons > Install from Disk, and set the path of the command there. The command
runs in its own Python: Blender's needs no package. The button is in the sidebar of the 3D view, under "topokit".
"""

import json
import subprocess
import tempfile
from pathlib import Path

try:
    import bpy
except ImportError:  # outside Blender only the functions below are of use
    bpy = None

bl_info = {
    "name": "topokit report",
    "blender": (4, 2, 0),
    "category": "Mesh",
    "description": "Genus, handles, boundaries and defects of the active mesh",
}


def write_obj(path, vertices, polygons):
    """Write corners (x, y, z) and polygons (vertex numbers from 0) as OBJ, with all digits."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(corner + 1) for corner in polygon) for polygon in polygons]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def command(program, path):
    """The words of the command line that reports on a file as JSON, with the places."""
    return [program, "report", str(path), "--json", "--locate"]


def answer(text):
    """What the command has printed: the lines to show, and the centers of the handles.

    Raises:
        ValueError: if the file could not be examined; the message says why.
    """
    (found,) = json.loads(text)
    if "error" in found:
        raise ValueError(found["error"])
    genus = "unknown" if found["genus"] is None else found["genus"]
    first = f"genus {genus}, χ {found['euler']} ({found['verdict']}), {'closed' if found['closed'] else 'not closed'}"
    location = found["location"]
    kinds = sorted({defect["kind"] for defect in location["defects"]})
    advice = [found["advice"]] if found["verdict"] == "unsure" and found["advice"] else []
    lines = [first, *(f"defects: {kind}" for kind in kinds), *advice]
    return lines, [tuple(handle["center"]) for handle in location["handles"]]


def examine(program, vertices, polygons):
    """The answer about a mesh; see `answer`.

    Raises:
        ValueError: if there is no such command, or the mesh could not be examined.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.obj"
        write_obj(path, vertices, polygons)
        try:
            done = subprocess.run(command(program, path), capture_output=True, text=True, encoding="utf-8", check=False)
        except OSError as error:
            raise ValueError(f"{program} does not start ({error}): set its path in the preferences.") from error
    if not done.stdout:
        raise ValueError(done.stderr.strip())
    return answer(done.stdout)


if bpy is not None:

    class TopokitPreferences(bpy.types.AddonPreferences):
        bl_idname = __name__
        program: bpy.props.StringProperty(name="Command", default="topokit", subtype="FILE_PATH")

        def draw(self, context):
            self.layout.prop(self, "program")

    class TopokitReport(bpy.types.Operator):
        """Genus, handles, boundaries and defects of the active mesh with its modifiers"""

        bl_idname, bl_label = "mesh.topokit_report", "Topology report"

        @classmethod
        def poll(cls, context):
            return context.active_object is not None and context.active_object.type == "MESH"

        def execute(self, context):
            shown = context.active_object.evaluated_get(context.evaluated_depsgraph_get())
            mesh = shown.to_mesh()
            vertices = [tuple(shown.matrix_world @ one.co) for one in mesh.vertices]
            polygons = [tuple(one.vertices) for one in mesh.polygons]
            shown.to_mesh_clear()
            try:
                lines, centers = examine(context.preferences.addons[__name__].preferences.program, vertices, polygons)
            except ValueError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            for number, center in enumerate(centers, 1):
                marker = bpy.data.objects.new(f"handle {number}", None)
                marker.location = center
                context.collection.objects.link(marker)
            self.report({"INFO"}, "; ".join(lines))
            return {"FINISHED"}

    class TopokitPanel(bpy.types.Panel):
        bl_label, bl_idname = "topokit", "VIEW3D_PT_topokit"
        bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "topokit"

        def draw(self, context):
            self.layout.operator(TopokitReport.bl_idname)

    CLASSES = (TopokitPreferences, TopokitReport, TopokitPanel)

    def register():
        for one in CLASSES:
            bpy.utils.register_class(one)

    def unregister():
        for one in reversed(CLASSES):
            bpy.utils.unregister_class(one)
