"""USD files, posed by UsdSkel itself and judged by all of USD's own validators."""

import sys

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, scene_of_three, textured_quad, write
from PIL import Image

import dfd
from dfd.posing.transforms import Transform

pxr = pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, UsdValidation  # noqa: E402

HALF = 2e-3  # what scales of 16 bits leave, of the size


def found_by_validators(path):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    stage = Usd.Stage.Open(str(path))
    return [each.GetErrorAsString() for each in UsdValidation.ValidationContext(validators).Validate(stage)]


def triangles(path, seconds=None):
    """(F, 3, 3) corners of all triangles as UsdSkel bakes them, part after part."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    time = Usd.TimeCode.Default() if seconds is None else Usd.TimeCode(seconds * stage.GetTimeCodesPerSecond())
    corners = []
    root = UsdSkel.Root(stage.GetDefaultPrim())
    cache = UsdSkel.Cache()
    if root:
        cache.Populate(root, Usd.PrimDefaultPredicate)
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        points = mesh.GetPointsAttr().Get()
        query = cache.GetSkinningQuery(prim) if root else None
        if query and query.HasBlendShapes():
            skeleton = cache.GetSkelQuery(UsdSkel.BindingAPI(prim).GetInheritedSkeleton())
            animation = skeleton.GetAnimQuery()
            weights = dict(zip(animation.GetBlendShapeOrder(), animation.ComputeBlendShapeWeights(time), strict=True))
            points = np.array(points, float)
            for target in UsdSkel.BindingAPI(prim).GetBlendShapeTargetsRel().GetTargets():
                blend = UsdSkel.BlendShape(stage.GetPrimAtPath(target))
                moved = weights[target.name] * np.array(blend.GetOffsetsAttr().Get())
                points[np.array(blend.GetPointIndicesAttr().Get())] += moved
        elif query:
            skeleton = cache.GetSkelQuery(UsdSkel.BindingAPI(prim).GetInheritedSkeleton())
            assert query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(time), points, time)  # in place
        places = np.array(points, float)
        corners.append(places[np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)])
    return np.concatenate(corners)


def bent(session):
    one = session.add(40, translation=(0.1, 0.2, -0.05), rotation=(20, 70, -10), scale=(1.5, 0.7, 1.1), name="left leg")
    two = session.add(900, translation=(0, 0.1, 0), instances="shared_pivot", name="left-leg")
    session.overlap = "normalize"
    return one, two


@pytest.mark.parametrize("ending", ["usda", "usdc", "usdz"])
def test_a_skin_is_what_pose_makes(ending, session, tmp_path):
    one, two = bent(session)
    pose = dfd.KeyPose(1.5, {one: Transform(rotation=(0, 200, 0)), two: Transform(scale=2, translation=(0, 1, 0))})
    path = tmp_path / f"rig.{ending}"
    report = dfd.export_rig(session, path, poses=[dfd.KeyPose(0), pose])
    assert found_by_validators(path) == []
    size, faces = session.mesh.diagonal, session.mesh.faces
    distance = np.linalg.norm(triangles(path) - session.vertices[faces], axis=2).max()
    assert distance < HALF * size
    assert report.largest == pytest.approx(distance, abs=1e-5 * size)
    assert report.influences > 2
    assert report.paths == (path,)
    assert np.abs(triangles(path, 0) - session.mesh.vertices[faces]).max() < 1e-5 * size
    for handle, transform in pose.transforms.items():
        parts = {"translation": transform.translation, "rotation": transform.rotation, "scale": transform.scale}
        session.move(handle, **parts, pivot="point")
    assert np.abs(triangles(path, 1.5) - session.vertices[faces]).max() < 1e-5 * size


def test_without_uneven_scales_nothing_is_lost(session, tmp_path):
    session.add(40, translation=(0.1, 0.2, -0.05), rotation=(20, 70, -10), scale=1.5)
    session.set_symmetry("x", band=0.1)
    session.set_default(rotation=(0, 30, 0))
    report = dfd.export_rig(session, tmp_path / "rig.usdc")
    assert np.abs(triangles(tmp_path / "rig.usdc") - session.vertices[session.mesh.faces]).max() < 2e-6 * report.size
    assert report.largest < 2e-6 * report.size


def test_influences_are_as_many_as_asked_for(session, tmp_path):
    bent(session)
    assert dfd.export_rig(session, tmp_path / "rig.usda", influences=2).influences == 2
    stage = Usd.Stage.Open(str(tmp_path / "rig.usda"))
    mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    assert UsdSkel.BindingAPI(mesh).GetJointIndicesPrimvar().GetElementSize() == 2
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/shape/skeleton"))
    tokens, names = skeleton.GetJointsAttr().Get(), skeleton.GetJointNamesAttr().Get()
    assert list(tokens)[:2] == ["root", "root/left_leg"]
    assert tokens[-1].startswith("root/left_leg_")
    assert list(names)[1] == "left leg"
    assert names[-1] == "left-leg"


@pytest.mark.parametrize("form", ["morph", "baked"])
def test_the_other_forms(form, session, tmp_path):
    one, _ = bent(session)
    session.overlap = "add"
    poses = [dfd.KeyPose(1), dfd.KeyPose(2, {one: Transform(rotation=(0, 90, 0))}, "turned")] if form == "morph" else []
    report = dfd.export_rig(session, tmp_path / "shape.usda", form=form, poses=poses)
    assert found_by_validators(tmp_path / "shape.usda") == []
    tolerance = 2e-6 * session.mesh.diagonal
    assert np.abs(triangles(tmp_path / "shape.usda") - session.vertices[session.mesh.faces]).max() < tolerance
    assert report.targets == (3 if form == "morph" else 0)
    if poses:
        rest = triangles(tmp_path / "shape.usda", 1)
        assert np.abs(rest - session.mesh.vertices[session.mesh.faces]).max() < tolerance


def test_parts_colors_and_textures_come_along(tmp_path, make_session):
    session = make_session(dfd.load(scene_of_three(tmp_path)))
    session.add(3, translation=(0, 0.1, 0), instances="shared_pivot")
    report = dfd.export_rig(session, tmp_path / "rig.usda")
    assert found_by_validators(tmp_path / "rig.usda") == []
    assert report.paths == (tmp_path / "rig.usda", tmp_path / "rig_texture_0.png")
    stage = Usd.Stage.Open(str(tmp_path / "rig.usda"))
    meshes = {prim.GetName(): prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)}
    assert set(meshes) == {"square", "near", "far"}
    assert np.abs(triangles(tmp_path / "rig.usda") - session.vertices[session.mesh.faces]).max() < 1e-5
    material, _ = UsdShade.MaterialBindingAPI(meshes["square"]).ComputeBoundMaterial()
    texture = UsdShade.Shader(stage.GetPrimAtPath(f"{material.GetPath()}/texture"))
    assert texture.GetInput("file").Get().path == "./rig_texture_0.png"
    st = UsdGeom.PrimvarsAPI(meshes["square"]).GetPrimvar("st")
    np.testing.assert_allclose(st.Get(), [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)], atol=1e-6)
    colors = np.array(UsdGeom.Mesh(meshes["near"]).GetDisplayColorPrimvar().Get())
    assert {tuple(row) for row in colors.tolist()} == {(1, 0, 0), (0, 1, 0)}


def lit_quad(folder, **material):
    """The textured square with a material of every kind of texture, and a second set of coordinates, moved."""
    uv = [(0, 1), (0.5, 1), (0.5, 0.5), (0, 0.5)]
    gltf = textured_quad(folder, TEXCOORD_1=(uv, 5126, "VEC2"))
    for number, color in enumerate([(128, 128, 255), (0, 64, 192), (255, 128, 0), (10, 20, 30)], 1):
        Image.new("RGB", (2, 2), color).save(folder / f"{number}.png")
        view = gltf.view((folder / f"{number}.png").read_bytes())
        gltf.header["images"].append({"bufferView": view, "mimeType": "image/png"})
        gltf.header["textures"].append({"source": number, "sampler": 0})
    gltf.header["samplers"] = [{"wrapS": 33071, "wrapT": 33648}]
    moved = {"KHR_texture_transform": {"offset": [0.25, 0], "scale": [2, 2]}}
    gltf.header["materials"][0] |= {
        "normalTexture": {"index": 1},
        "occlusionTexture": {"index": 3, "texCoord": 1, "strength": 0.75},
        "emissiveTexture": {"index": 4, "extensions": moved},
        "emissiveFactor": [1, 0.5, 0.25],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
        **material,
    }
    base = gltf.header["materials"][0]["pbrMetallicRoughness"]
    base |= {"metallicFactor": 0.5, "roughnessFactor": 0.25, "metallicRoughnessTexture": {"index": 2, "texCoord": 1}}
    return write(folder / "quad.glb", gltf.glb())


def preview(stage, name):
    """Of an input of the first surface: its value, or the shader that feeds it and the name of its output."""
    surface = UsdShade.Shader(stage.GetPrimAtPath("/shape/materials/material_0/surface"))
    sources, _ = surface.GetInput(name).GetConnectedSources()
    if not sources:
        return surface.GetInput(name).Get()
    return UsdShade.Shader(sources[0].source.GetPrim()), sources[0].sourceName


def shown(shader, name):
    return shader.GetInput(name).Get()


def varname(shader):
    reader = UsdShade.Shader(shader.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
    return reader.GetInput("varname").Get()


def test_materials_are_those_of_the_gltf_file(tmp_path, make_session):
    session = make_session(dfd.load(lit_quad(tmp_path)))
    session.add(0, translation=(0, 0, 1))
    report = dfd.export_rig(session, tmp_path / "rig.usda")
    assert found_by_validators(tmp_path / "rig.usda") == []
    assert [path.name for path in report.paths[1:]] == [f"rig_texture_{number}.png" for number in range(5)]
    assert report.notes == ()
    stage = Usd.Stage.Open(str(tmp_path / "rig.usda"))

    rough, green = preview(stage, "roughness")
    metal, blue = preview(stage, "metallic")
    assert (green, blue) == ("g", "b")
    assert rough.GetPrim() == metal.GetPrim()
    np.testing.assert_allclose(shown(rough, "scale"), (1, 0.25, 0.5, 1))
    assert shown(rough, "sourceColorSpace") == "raw"
    assert (shown(rough, "wrapS"), shown(rough, "wrapT")) == ("clamp", "mirror")

    normal, _ = preview(stage, "normal")
    np.testing.assert_allclose(shown(normal, "scale"), (2, 2, 2, 1))
    np.testing.assert_allclose(shown(normal, "bias"), (-1, -1, -1, 0))
    occlusion, _ = preview(stage, "occlusion")
    assert shown(occlusion, "scale")[0] == 0.75
    assert shown(occlusion, "bias")[0] == 0.25
    glow, _ = preview(stage, "emissiveColor")
    np.testing.assert_allclose(shown(glow, "scale"), (4, 2, 1, 1))
    assert shown(glow, "sourceColorSpace") == "sRGB"

    texels = np.array(Image.open(tmp_path / shown(rough, "file").path))
    assert texels.reshape(-1, 3).tolist() == [[0, 64, 192]] * 4
    mesh = UsdGeom.Mesh(next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)))
    corners = [0, 1, 2, 0, 2, 3]
    second = np.array([(0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5)])[corners]
    base = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])[corners]
    moved = np.column_stack([0.25 + 2 * base[:, 0], 1 - 2 * (1 - base[:, 1])])
    for shader, wanted in ((normal, base), (rough, second), (occlusion, second), (glow, moved)):
        found = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(varname(shader)).Get()
        np.testing.assert_allclose(found, wanted, atol=1e-6)
    assert mesh.GetDoubleSidedAttr().Get() is False


def test_opacity_and_both_sides(tmp_path, make_session):
    clear = {"alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": True, "normalTexture": {"index": 1, "scale": 0.5}}
    session = make_session(dfd.load(lit_quad(tmp_path, **clear)))
    session.add(0, translation=(0, 0, 1))
    report = dfd.export_rig(session, tmp_path / "rig.usdz", form="baked")
    assert found_by_validators(tmp_path / "rig.usdz") == []
    assert report.notes == ("USD does not scale normal textures: paint",)
    stage = Usd.Stage.Open(str(tmp_path / "rig.usdz"))
    assert preview(stage, "opacityThreshold") == 0.25
    assert preview(stage, "opacity")[1] == "a"
    assert next(UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)).GetDoubleSidedAttr().Get()


def test_vertex_colors_are_display_colors_times_the_factor(tmp_path, make_session):
    gltf = Gltf()
    colors = gltf.accessor(np.tile([(1, 0.5, 0.25, 0.5)], (8, 1)), 5126, "VEC4")
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE, attributes={"COLOR_0": colors}, material=0))
    factor = {"baseColorFactor": [0.5, 1, 1, 0.5], "metallicFactor": 0, "roughnessFactor": 0.5}
    gltf.header["materials"] = [{"pbrMetallicRoughness": factor, "alphaMode": "BLEND", "emissiveFactor": [0, 1, 0]}]
    session = make_session(dfd.load(write(tmp_path / "cube.glb", gltf.glb())))
    session.add(0, translation=(0, 0, 1))
    dfd.export_rig(session, tmp_path / "rig.usdc")
    assert found_by_validators(tmp_path / "rig.usdc") == []
    stage = Usd.Stage.Open(str(tmp_path / "rig.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/shape/cube"))
    np.testing.assert_allclose(mesh.GetDisplayColorPrimvar().Get()[0], (0.5, 0.5, 0.25), atol=2e-3)
    np.testing.assert_allclose(mesh.GetDisplayOpacityPrimvar().Get()[0], 0.25, atol=1e-6)
    assert shown(preview(stage, "diffuseColor")[0], "varname") == "displayColor"
    assert shown(preview(stage, "opacity")[0], "varname") == "displayOpacity"
    assert (preview(stage, "metallic"), preview(stage, "roughness")) == (0, 0.5)
    np.testing.assert_allclose(preview(stage, "emissiveColor"), (0, 1, 0))


def test_materials_that_make_no_sense_are_taken_as_far_as_they_do(tmp_path, make_session):
    odd = {
        "emissiveFactor": [1, "x"],
        "normalTexture": {"index": 99},
        "occlusionTexture": {"index": 1, "texCoord": 7, "strength": float(3)},
        "emissiveTexture": "no",
        "doubleSided": "yes",
    }
    session = make_session(dfd.load(lit_quad(tmp_path, **odd)))
    session.add(0, translation=(0, 0, 1))
    report = dfd.export_rig(session, tmp_path / "rig.usda")
    assert found_by_validators(tmp_path / "rig.usda") == []
    assert report.notes == ("could not be read: the texture of material 'paint'",)
    stage = Usd.Stage.Open(str(tmp_path / "rig.usda"))
    surface = UsdShade.Shader(stage.GetPrimAtPath("/shape/materials/material_0/surface"))
    named = {each.GetBaseName() for each in surface.GetInputs()}
    assert named == {"diffuseColor", "opacity", "metallic", "roughness"}


def test_textures_that_vertex_colors_tint_are_told(tmp_path, make_session):
    gltf = textured_quad(tmp_path, COLOR_0=([(1, 0, 0, 1)] * 4, 5126, "VEC4"))
    session = make_session(dfd.load(write(tmp_path / "quad.glb", gltf.glb())))
    session.add(0, translation=(0, 0, 1))
    assert "vertex colors do not tint textures" in str(dfd.export_rig(session, tmp_path / "rig.usda"))
    assert found_by_validators(tmp_path / "rig.usda") == []


def test_a_package_holds_its_texture(tmp_path, make_session):
    session = make_session(dfd.load(write(tmp_path / "quad.glb", textured_quad(tmp_path).glb())))
    session.add(0, translation=(0, 0, 1))
    report = dfd.export_rig(session, tmp_path / "rig.usdz")
    assert report.paths == (tmp_path / "rig.usdz",)
    assert found_by_validators(tmp_path / "rig.usdz") == []
    assert {path.suffix for path in tmp_path.iterdir()} == {".glb", ".png", ".usdz"}  # the .png is the quad's own
    files = UsdUtils.ComputeAllDependencies(str(tmp_path / "rig.usdz"))
    assert any("rig_texture_0.png" in str(asset) for asset in files[1])


def test_several_materials_have_faces_of_their_own(tmp_path, make_session):
    write(tmp_path / "two.mtl", "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    square = "mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n"
    mesh = dfd.load(write(tmp_path / "two.obj", square))
    session = make_session(mesh)
    session.add(0, translation=(0, 0, 1))
    dfd.export_rig(session, tmp_path / "rig.usda")
    assert found_by_validators(tmp_path / "rig.usda") == []
    stage = Usd.Stage.Open(str(tmp_path / "rig.usda"))
    colors = set()
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Subset) or prim.IsA(UsdGeom.Mesh):
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            if material:
                surface = UsdShade.Shader(stage.GetPrimAtPath(f"{material.GetPath()}/surface"))
                colors.add(tuple(surface.GetInput("diffuseColor").Get()))
    assert colors == {(1, 0, 0), (0, 0, 1)}


def test_without_the_packages_it_says_which(session, tmp_path, monkeypatch):
    session.add(40)
    for name in [name for name in sys.modules if name.startswith("dfd.export.usd")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(ValueError, match=r"USD files need more packages \(pxr\): pip install 'dfd\[export\]'"):
        dfd.export_rig(session, tmp_path / "rig.usda")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there(session, tmp_path):
    session.add(40)
    with pytest.raises(OSError, match="does not exist"):
        dfd.export_rig(session, tmp_path / "missing" / "rig.usda")
