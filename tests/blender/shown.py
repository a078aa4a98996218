"""Write the shape that Blender shows for a GLB file. It runs in a Python that has bpy.

Arguments: the file, an .npz file to write, and a frame.
"""

import sys

import bpy
import numpy as np


def gltf_axes(places):
    """Return positions in glTF's axes, y up, from positions in Blender's axes, z up."""
    return np.stack([places[..., 0], places[..., 2], -places[..., 1]], axis=-1)


def main(path, out, frame):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path, disable_bone_shape=True)
    bpy.context.scene.render.fps = 24
    bpy.context.scene.frame_set(int(frame))
    graph = bpy.context.evaluated_depsgraph_get()
    found = {}
    for name, key in (("triangles", True), ("rest", False)):
        corners = []
        for thing in [each for each in bpy.context.scene.objects if each.type == "MESH"]:
            shown = thing.evaluated_get(graph) if key else thing
            mesh = shown.to_mesh()
            mesh.calc_loop_triangles()
            places = np.empty(3 * len(mesh.vertices))
            mesh.vertices.foreach_get("co", places)
            numbers = np.empty(3 * len(mesh.loop_triangles), np.int32)
            mesh.loop_triangles.foreach_get("vertices", numbers)
            world = np.array(shown.matrix_world)
            placed = places.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
            corners.append(gltf_axes(placed)[numbers.reshape(-1, 3)])
            shown.to_mesh_clear()
        found[name] = np.concatenate(corners)
    meshes = [each for each in bpy.context.scene.objects if each.type == "MESH"]
    found["groups"] = np.array(sorted({group.name for mesh in meshes for group in mesh.vertex_groups}))
    armatures = [each for each in bpy.context.scene.objects if each.type == "ARMATURE"]
    found["bones"] = np.array(sorted(bone.name for armature in armatures for bone in armature.data.bones))
    found["keys"] = np.array(sorted(k.name for m in meshes if m.data.shape_keys for k in m.data.shape_keys.key_blocks))
    found["actions"] = np.array(sorted(action.name for action in bpy.data.actions))
    np.savez(out, **found)


main(*sys.argv[-3:])
