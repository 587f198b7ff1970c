#!/usr/bin/env python3
"""Writes small valid models, where the fuzzing of the text formats starts.

Usage: make_seeds.py FOLDER; makes FOLDER/{gltf,glb,assimp,ply,obj,stl,pbrt,mitsuba}/.
"""
import base64
import json
import os
import struct
import sys
import zlib

POSITIONS = (0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0)
NORMALS = (0, 0, 1) * 4
UVS = (0, 0, 1, 0, 0, 1, 1, 1)
COLORS = (255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 9, 9, 9, 0)
INDICES = (0, 1, 2, 2, 1, 3)


def plain():
    """A document and its buffer: two triangles with positions and indices."""
    data = struct.pack("<12f6H", *POSITIONS, *INDICES)
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "n"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48},
                        {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"byteLength": len(data)}]}, data


def attributes():
    """All vertex attributes, and primitives of every mode."""
    data = struct.pack("<12f12f8f16B6I", *POSITIONS, *NORMALS, *UVS, *COLORS, *INDICES)
    tree, _ = plain()
    sizes = (48, 48, 32, 16, 24)
    kinds = ((5126, 4, "VEC3"), (5126, 4, "VEC3"), (5126, 4, "VEC2"), (5121, 4, "VEC4"),
             (5125, 6, "SCALAR"))
    tree["bufferViews"] = [{"buffer": 0, "byteOffset": sum(sizes[:i]), "byteLength": size}
                           for i, size in enumerate(sizes)]
    tree["accessors"] = [{"bufferView": i, "componentType": c, "count": n, "type": t}
                         for i, (c, n, t) in enumerate(kinds)]
    tree["accessors"][3]["normalized"] = True
    names = ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0")
    tree["meshes"] = [{"primitives": [
        {"attributes": {name: i for i, name in enumerate(names)}, "indices": 4},
        {"attributes": {"POSITION": 0}, "mode": 5}, {"attributes": {"POSITION": 0}, "mode": 6}]}]
    return tree, data


def with_material(material, **more):
    """A triangle with texture coordinates and a material, whose texture 0 has a broken image."""
    tree, _ = plain()
    data = struct.pack("<9f6f", *POSITIONS[:9], *UVS[:6])
    tree["bufferViews"] = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}]
    tree["accessors"] = [{"bufferView": v, "componentType": 5126, "count": 3, "type": t}
                         for v, t in enumerate(("VEC3", "VEC2"))]
    tree["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}]
    tree["images"] = [{"uri": "data:image/png;base64,iVBORw0KGgo="}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [material]
    tree.update(more)
    return tree, data


def materials():
    """A material's own fields, and each extension of materials."""
    texture = {"index": 0, "texCoord": 0}
    yield with_material({
        "name": "m", "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": True,
        "emissiveFactor": [1, 0.5, 0], "emissiveTexture": texture,
        "normalTexture": {"index": 0, "scale": 0.5}})
    yield with_material({
        "pbrMetallicRoughness": {
            "baseColorFactor": [1, 0.5, 0.2, 1], "metallicFactor": 0.5, "roughnessFactor": 0.3,
            "metallicRoughnessTexture": texture,
            "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {
                "offset": [0.5, 0], "rotation": 1, "scale": [2, 2], "texCoord": 0}}}}},
        samplers=[{"wrapS": 33071, "wrapT": 33648}], textures=[{"source": 0, "sampler": 0}])
    yield with_material({"extensions": {
        "KHR_materials_emissive_strength": {"emissiveStrength": 9},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 1, 0],
                                   "specularTexture": texture, "specularColorTexture": texture},
        "KHR_materials_ior": {"ior": 1.3},
        "KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": texture},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2,
                                 "attenuationColor": [1, 0.5, 0]}}})
    yield with_material({"extensions": {
        "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.5,
                                    "clearcoatTexture": texture, "clearcoatNormalTexture": texture},
        "KHR_materials_sheen": {"sheenColorFactor": [1, 0, 0], "sheenRoughnessFactor": 0.5},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 1},
        "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceIor": 1.3,
                                      "iridescenceThicknessMaximum": 400}}})
    yield with_material({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [1, 1, 1, 1], "specularFactor": [1, 1, 1], "glossinessFactor": 0.5,
        "diffuseTexture": texture, "specularGlossinessTexture": texture}}})
    yield with_material({"alphaMode": "BLEND", "extensions": {"KHR_materials_unlit": {}}})


def placed():
    """Transforms, cameras and lights."""
    tree, data = plain()
    tree["nodes"] = [
        {"children": [1, 2, 3, 4], "translation": [1, 2, 3], "rotation": [0, 0, 0.6, 0.8]},
        {"mesh": 0, "scale": [1, -2, 3], "extensions": {"KHR_node_visibility": {"visible": False}}},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]},
        {"camera": 0, "extras": {"trex_volume": {"file": "none.vdb", "density": 2}}},
        {"camera": 1, "extensions": {"KHR_lights_punctual": {"light": 0}}}]
    tree["cameras"] = [
        {"type": "perspective", "name": "c", "perspective": {"yfov": 0.7, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}}]
    tree["extensionsUsed"] = ["KHR_lights_punctual"]
    tree["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "spot", "intensity": 5, "color": [1, 1, 0], "range": 9,
         "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}},
        {"type": "point"}, {"type": "directional"}]}}
    return tree, data


def sparse():
    """Strided, sparse and quantised accessors."""
    data = struct.pack("<12f", *POSITIONS) + struct.pack("<3B", 0, 1, 2) + b"\0"
    data += struct.pack("<H2x3f", 1, 0.5, 0.5, 0.5) + struct.pack("<12h", *range(12))
    tree, _ = plain()
    tree["bufferViews"] = [
        {"buffer": 0, "byteLength": 48, "byteStride": 12},
        {"buffer": 0, "byteOffset": 48, "byteLength": 3}, {"buffer": 0, "byteOffset": 52, "byteLength": 2},
        {"buffer": 0, "byteOffset": 56, "byteLength": 12}, {"buffer": 0, "byteOffset": 68, "byteLength": 24}]
    tree["accessors"] = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
            "count": 1, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}}},
        {"bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR"},
        {"bufferView": 4, "componentType": 5122, "count": 4, "type": "VEC3", "normalized": True}]
    tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 2
    tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    return tree, data


def gltf(tree, data):
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    tree["buffers"] = [{"byteLength": len(data), "uri": uri}]
    return json.dumps(tree, separators=(",", ":")).encode()


def glb(tree, data):
    tree["buffers"] = [{"byteLength": len(data)}]
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def handed_over(tree, data):
    """As trex-assimp writes it."""
    tree["asset"]["extras"] = {"replaced": ["a part"], "warnings": ["w"], "files": ["a.bin"]}
    return glb(tree, data)


def ply():
    header = ("ply\nformat {} 1.0\ncomment c\nelement vertex 4\nproperty {} x\nproperty {} y\nproperty {} z\n"
              "{}element face 1\nproperty list uchar int vertex_indices\n{}end_header\n")
    rest = "property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n" \
           "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
    rows = [POSITIONS[3 * i:3 * i + 3] for i in range(4)]
    lines = "".join("{} {} {}\n".format(*row) for row in rows)
    yield header.format("ascii", *["float"] * 3, "", "").encode() + f"{lines}4 0 1 3 2\n".encode()
    full = "".join("{} {} {} 0 0 1 0.5 0.5 1 2 3 4\n".format(*row) for row in rows)
    yield header.format("ascii", *["double"] * 3, rest, "element edge 1\nproperty list uint short a\n").encode() + \
        f"{full}3 0 1 2\n2 7 8\n".encode()
    for order, mark in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        body = b"".join(struct.pack(mark + "3d5f4B", *row, 0, 0, 1, 0.5, 0.5, 1, 2, 3, 4) for row in rows)
        body += struct.pack(mark + "B4i", 4, 0, 1, 3, 2)
        yield header.format(order, *["double"] * 3, rest, "").encode() + body
        body = b"".join(struct.pack(mark + "3f", *row) for row in rows) + struct.pack(mark + "B3iHb", 3, 0, 1, 2, 1, 5)
        yield header.format(order, *["float"] * 3, "", "property list ushort char extra\n").encode() + body
    pack = zlib.compressobj(wbits=31)
    yield pack.compress(header.format("ascii", *["float"] * 3, "", "").encode() + f"{lines}4 0 1 3 2\n".encode()) + pack.flush()


OBJ = [b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
       b"# c\no thing\ng a b\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 1\nvt 0 0\nvt 1 1 0\n"
       b"vn 0 0 1\ns 1\nf -4/1/1 -3/2/1 -2/1/1 -1/2/1\nf 1//1 2//1 3//1\nf 1/1 2/2 \\\n3/1\n",
       b"v 0 0 0 9 0 0\nv 1 0 0\nv 0 1 0\n#MRGB ff00ff00ff0000ff\nf 1 2 3\n",
       b"mtllib input.mtl\nusemtl red\nv 0 0 0\nv 1e3 0 0\nv 0 1e-3 0\nf 1 2 3\nusemtl glass\nf 3 2 1\nl 1 2\np 1\n"
       b"#mtl\nnewmtl red\nKd 1 0 0\nKe 2 2 2\nKs 0.5 0.5 0.5\nNs 50\nmap_Kd -s 1 1 1 -o 0.5 0 0 a.png\n"
       b"newmtl glass\nNi 1.5\nd 0.5\nTr 0.5\nillum 7\nPr 0.2\nPm 1\nmap_Ke b.png\nmap_d a.png\nbump -bm 0.5 n.png\n"]


PBRT = [b'''LookAt 0 0 5 0 0 0 0 1 0
Film "image" "integer xresolution" [4] "integer yresolution" 2 "float scale" 2
Camera "perspective" "float fov" [40] "float lensradius" .1 "float focaldistance" 5
Sampler "halton"
WorldBegin
Texture "c" "spectrum" "checkerboard" "float uscale" 4 "rgb tex1" [1 0 0] "rgb tex2" [0 1 0]
Texture "s" "spectrum" "scale" "texture tex1" "c" "rgb tex2" [.5 .5 .5]
Texture "m" "float" "mix" "float tex1" .1 "texture tex2" "c" "float amount" .5
MakeNamedMaterial "u" "string type" "uber" "texture Kd" "s" "rgb Kt" [.1 .1 .1] "texture opacity" "m"
MakeNamedMaterial "x" "string type" "mix" "string namedmaterial1" "u" "string namedmaterial2" "u"
ObjectBegin "o"
NamedMaterial "u"
Shape "trianglemesh" "point P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2] "normal N" [0 0 1 0 0 1 0 0 1]
ObjectEnd
AttributeBegin
Rotate 30 0 1 0
Translate 1 2 3
ObjectInstance "o"
AttributeEnd
LightSource "spot" "rgb I" [1 1 1] "point from" [0 1 0] "point to" [0 0 0] "float coneangle" 30
LightSource "infinite" "blackbody L" [3000 2]
TransformBegin
Scale 2 2 2
AreaLightSource "diffuse" "spectrum L" [400 1 700 2]
Material "plastic" "float uroughness" .1 "float vroughness" .2
Shape "trianglemesh" "point P" [0 0 0 1 0 0 0 1 0]
TransformEnd
Include "in.pbrt"
WorldEnd
#in
Material "metal" "spectrum eta" "Au.eta.spd"
Shape "cylinder" "float phimax" 90 "float zmin" 0
Include "input.pbrt"
''', b'''Option "bool disablepixeljitter" true
ColorSpace "rec2020"
Scale -1 1 1
Film "rgb" "float iso" 200
Camera "orthographic" "float screenwindow" [-1 1 -1 1]
WorldBegin
Attribute "shape" "float radius" 2
MakeNamedMedium "g" "string type" "homogeneous" "rgb sigma_a" [1 2 3]
MediumInterface "g" ""
Material "dielectric" "spectrum eta" "glass-BK7" "float roughness" .1
Shape "bilinearmesh" "point3 P" [0 0 0 1 0 0 0 1 0 1 1 1] "point2 uv" [0 0 1 0 0 1 1 1] "float alpha" .5
LightSource "point" "rgb I" [1 2 3] "float power" 5
LightSource "distant" "float illuminance" 3
LightSource "infinite" "string filename" "none.exr"
AreaLightSource "diffuse" "float power" 3 "bool twosided" true
Shape "plymesh" "string filename" "none.ply"
Import "in.pbrt"
#in
ActiveTransform EndTime
Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]
CoordinateSystem "a"
CoordSysTransform "a"
ReverseOrientation
Material "conductor" "rgb reflectance" [.5 .5 .5]
Shape "disk" "float innerradius" .5 "float height" 1
''']


def stl():
    facets = [POSITIONS[0:9], POSITIONS[3:12]]
    yield struct.pack("<80sI", b"solid s", 2) + b"".join(struct.pack("<12fH", 0, 0, 1, *f, 0) for f in facets)
    yield ("solid s\n" + "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join("vertex {} {} {}\n".format(*f[k:k + 3]) for k in (0, 3, 6)) +
        "endloop\nendfacet\n" for f in facets) + "endsolid s\n").encode()


def bent():
    """A skin and a morph target."""
    data = struct.pack("<12f", *POSITIONS) + struct.pack("<16B", *[0] * 16) + struct.pack("<16f", *[1, 0, 0, 0] * 4)
    data += struct.pack("<16f", *[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
    tree, _ = plain()
    views = ((0, 48), (48, 16), (64, 64), (128, 64))
    tree["bufferViews"] = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in views]
    shapes = ((5126, 4, "VEC3"), (5121, 4, "VEC4"), (5126, 4, "VEC4"), (5126, 1, "MAT4"))
    tree["accessors"] = [{"bufferView": v, "componentType": c, "count": n, "type": t}
                         for v, (c, n, t) in enumerate(shapes)]
    tree["meshes"] = [{"weights": [0.5], "primitives": [{
        "attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}, "targets": [{"POSITION": 0}]}]}]
    tree["skins"] = [{"joints": [1], "inverseBindMatrices": 3}]
    tree["nodes"] = [{"mesh": 0, "skin": 0}, {"translation": [1, 2, 3], "rotation": [0, 0, 0, 1]}]
    tree["scenes"] = [{"nodes": [0, 1]}]
    return tree, data


def moved():
    """An animation of a node and of weights, instances and variants."""
    data = struct.pack("<9f2f", *POSITIONS[:9], 0, 1)
    tree, _ = plain()
    tree["bufferViews"] = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 8}]
    tree["accessors"] = [{"bufferView": v, "componentType": 5126, "count": n, "type": t}
                         for v, n, t in ((0, 3, "VEC3"), (1, 2, "SCALAR"))]
    tree["meshes"] = [{"primitives": [{
        "attributes": {"POSITION": 0}, "targets": [{"POSITION": 0}],
        "extensions": {"KHR_materials_variants": {"mappings": [{"material": 0, "variants": [0]}]}}}]}]
    tree["materials"] = [{}]
    tree["nodes"] = [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}}]
    tree["animations"] = [{
        "samplers": [{"input": 1, "output": 0, "interpolation": "LINEAR"}, {"input": 1, "output": 1}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}},
                     {"sampler": 1, "target": {"node": 0, "path": "weights"}}]}]
    tree["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "v"}]}}
    tree["extensionsUsed"] = ["EXT_mesh_gpu_instancing", "KHR_materials_variants"]
    return tree, data


def compressed():
    """Views and primitives that say they are compressed; their bytes are not."""
    tree, data = plain()
    tree["bufferViews"][0]["extensions"] = {"EXT_meshopt_compression": {
        "buffer": 0, "byteOffset": 0, "byteLength": 48, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES",
        "filter": "NONE"}}
    tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "extensions": {
        "KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}})
    tree["extensionsUsed"] = ["EXT_meshopt_compression", "KHR_draco_mesh_compression"]
    return tree, data


def mitsuba():
    """Every kind of object, and a serialized mesh behind its scene."""
    def scene(text, version="3.0.0"):
        return f'<scene version="{version}">\n{text}\n</scene>\n'.encode()
    yield scene("""<default name="r" value="0.5"/><integrator type="path"><integer name="max_depth" value="8"/></integrator>
<sensor type="thinlens" id="c"><float name="fov" value="40"/><string name="fov_axis" value="y"/><transform name="to_world">
<lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform><float name="aperture_radius" value="0.1"/>
<film type="hdrfilm"><integer name="width" value="64"/></film></sensor>
<bsdf type="twosided" id="a"><bsdf type="roughplastic"><float name="alpha" value="0.1"/><rgb name="diffuse_reflectance" value="$r"/>
</bsdf></bsdf><bsdf type="mask" id="b"><float name="opacity" value="0.5"/><bsdf type="roughconductor">
<string name="material" value="Au"/></bsdf></bsdf><bsdf type="blendbsdf" id="d"><ref id="a"/><ref id="b"/></bsdf>
<shape type="sphere"><point name="center" x="1" y="2" z="3"/><float name="radius" value="2"/><ref id="a"/></shape>
<shape type="cylinder"><ref id="b"/></shape><shape type="disk"><ref id="d"/><emitter type="area">
<spectrum name="radiance" value="400:1, 700:2"/></emitter></shape><shape type="shapegroup" id="g"><shape type="cube">
<bsdf type="dielectric"><string name="int_ior" value="bk7"/></bsdf><medium type="homogeneous" name="interior"/></shape></shape>
<shape type="instance"><ref id="g"/><transform name="to_world"><scale value="2"/><rotate x="1" angle="30"/></transform></shape>""")
    yield scene("""<shape type="rectangle"><transform name="toWorld"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/>
<translate x="1"/></transform><bsdf type="bumpmap"><texture type="checkerboard" name="arbitrary"><transform name="toUV">
<scale x="3" y="4"/></transform></texture><bsdf type="principled"><float name="metallic" value="0.5"/></bsdf></bsdf></shape>
<emitter type="point"><rgb name="intensity" value="1,2,3"/></emitter><emitter type="spot"/><emitter type="directional">
<vector name="direction" x="0" y="-1" z="0"/></emitter><emitter type="constant"><blackbody name="radiance" temperature="5000K"/>
</emitter><sensor type="orthographic"/>""", "0.6.0")
    data = struct.pack("<I", 0x1002) + b"m\0" + struct.pack("<QQ", 4, 2) + struct.pack("<12f8f6I", *POSITIONS, *UVS, *INDICES)
    packed = struct.pack("<HH", 0x041C, 4) + zlib.compress(data)
    yield scene("""<shape type="serialized"><string name="filename" value="m.serialized"/>
<integer name="shapeIndex" value="0"/><float name="maxSmoothAngle" value="30"/></shape>""") + b"=====\n" + packed + struct.pack(
        "<QI", 0, 1)


def main(folder):
    handed = [plain(), attributes(), sparse(), placed(), *materials()]
    models = [*handed, bent(), moved(), compressed()]
    seeds = {"gltf": [gltf(*m) for m in models], "glb": [glb(*m) for m in models],
             "assimp": [handed_over(*m) for m in handed], "ply": list(ply()), "obj": OBJ, "stl": list(stl()),
             "pbrt": PBRT, "mitsuba": list(mitsuba())}
    for name, inputs in seeds.items():
        os.makedirs(os.path.join(folder, name), exist_ok=True)
        for i, data in enumerate(inputs):
            with open(os.path.join(folder, name, f"seed-{i}.{name}"), "wb") as f:
                f.write(data)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: make_seeds.py FOLDER")
    main(sys.argv[1])
