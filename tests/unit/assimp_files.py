"""One small model in the formats that assimp reads, as text or bytes: writers by extension.

Each takes corners, triangles and a colour; what the format can't tell is left out.
"""
import io, struct, zipfile


def triple(p):
    return "%.9g %.9g %.9g" % tuple(p)


def obj(points, faces, color):
    return "mtllib model.mtl\n" + "".join(f"v {triple(p)}\n" for p in points) + "usemtl paint\n" + "".join(
        "f %d %d %d\n" % tuple(i + 1 for i in f) for f in faces)


def off(points, faces, color):
    return f"OFF\n{len(points)} {len(faces)} 0\n" + "".join(f"{triple(p)}\n" for p in points) + "".join(
        "3 %d %d %d\n" % tuple(f) for f in faces)


def ac(points, faces, color):
    return (f'AC3Db\nMATERIAL "paint" rgb {triple(color)}  amb 0 0 0  emis 0 0 0  spec 0 0 0  shi 0  trans 0\nOBJECT world\nkids 1\n'
            f'OBJECT poly\nname "mesh"\nnumvert {len(points)}\n' + "".join(f"{triple(p)}\n" for p in points) +
            f"numsurf {len(faces)}\n" + "".join("SURF 0x20\nmat 0\nrefs 3\n%d 0 0\n%d 0 0\n%d 0 0\n" % tuple(f) for f in faces) + "kids 0\n")


def x3d(points, faces, color):
    index = " ".join("%d %d %d -1" % tuple(f) for f in faces)
    return (f'<?xml version="1.0"?><X3D version="3.0"><Scene><Shape><Appearance><Material diffuseColor="{triple(color)}"/></Appearance>'
            f'<IndexedFaceSet solid="false" coordIndex="{index}"><Coordinate point="{" ".join(map(triple, points))}"/>'
            "</IndexedFaceSet></Shape></Scene></X3D>")


def amf(points, faces, color):
    return ('<?xml version="1.0"?><amf unit="meter"><object id="0"><mesh><vertices>' + "".join(
        "<vertex><coordinates><x>%.9g</x><y>%.9g</y><z>%.9g</z></coordinates></vertex>" % tuple(p) for p in points) +
        "</vertices><volume>" + "".join("<triangle><v1>%d</v1><v2>%d</v2><v3>%d</v3></triangle>" % tuple(f) for f in faces) +
        "</volume></mesh></object></amf>")


def dxf(points, faces, color):
    def face(f):
        corners = [points[i] for i in (*f, f[2])]
        return "0\n3DFACE\n8\nlayer\n" + "".join(f"{10 + k}\n{p[0]:.9g}\n{20 + k}\n{p[1]:.9g}\n{30 + k}\n{p[2]:.9g}\n"
                                                   for k, p in enumerate(corners))
    return "0\nSECTION\n2\nENTITIES\n" + "".join(map(face, faces)) + "0\nENDSEC\n0\nEOF\n"


def nff(points, faces, color):
    return f"f {triple(color)} 1 0 0 0 1\n" + "".join("p 3\n" + "".join(f"{triple(points[i])}\n" for i in f) for f in faces)


def smd(points, faces, color):
    def corners(f):
        a, b, c = (points[i] for i in f)
        u, v = [q - p for p, q in zip(a, b)], [q - p for p, q in zip(a, c)]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        length = sum(k * k for k in n) ** 0.5
        return "".join(f"0 {triple(p)} {triple([k / length for k in n])} 0 0\n" for p in (a, b, c))
    return ('version 1\nnodes\n0 "root" -1\nend\nskeleton\ntime 0\n0 0 0 0 0 0 0\nend\ntriangles\n' +
            "".join("paint\n" + corners(f) for f in faces) + "end\n")


def ogex(points, faces, color):
    def rows(list_, form):
        return ", ".join("{" + ", ".join(form % v for v in row) + "}" for row in list_)
    return ('Metric (key = "distance") {float {1.0}}\nMetric (key = "up") {string {"y"}}\n'
            "GeometryNode $node1 { Name {string {\"mesh\"}} ObjectRef {ref {$geometry1}} MaterialRef (index = 0) {ref {$material1}} }\n"
            'GeometryObject $geometry1 { Mesh (primitive = "triangles") { VertexArray (attrib = "position") { float[3] { ' +
            rows(points, "%.9g") + " } } IndexArray { unsigned_int32[3] { " + rows(faces, "%d") + " } } } }\n"
            'Material $material1 { Name {string {"paint"}} Color (attrib = "diffuse") {float[3] {{' +
            ", ".join("%.9g" % c for c in color) + "}}} }\n")


def x(points, faces, color):
    return ("xof 0303txt 0032\nMesh mesh {\n" + f"{len(points)};\n" + ",\n".join("%.9g;%.9g;%.9g;" % tuple(p) for p in points) +
            f";\n{len(faces)};\n" + ",\n".join("3;%d,%d,%d;" % tuple(f) for f in faces) + ";\nMeshMaterialList {\n1;\n" +
            f"{len(faces)};\n" + ",".join("0" for _ in faces) + ";;\nMaterial paint {\n" + "%.9g;%.9g;%.9g;1.0;;\n0.0;\n0;0;0;;\n0;0;0;;\n}\n}\n}\n" % tuple(color))


def fbx(points, faces, color, unit=100.0, up=1, extra="", links=""):
    """Text, of version 7.3; `unit`: centimetres."""
    index = ",".join("%d,%d,%d" % (f[0], f[1], -1 - f[2]) for f in faces)
    numbers = ",".join("%.9g" % c for p in points for c in p)
    return f"""; FBX 7.3.0 project file
FBXHeaderExtension:  {{
	FBXHeaderVersion: 1003
	FBXVersion: 7300
}}
GlobalSettings:  {{
	Version: 1000
	Properties70:  {{
		P: "UpAxis", "int", "Integer", "",{up}
		P: "UpAxisSign", "int", "Integer", "",1
		P: "FrontAxis", "int", "Integer", "",{2 if up == 1 else 1}
		P: "FrontAxisSign", "int", "Integer", "",{1 if up == 1 else -1}
		P: "CoordAxis", "int", "Integer", "",0
		P: "CoordAxisSign", "int", "Integer", "",1
		P: "UnitScaleFactor", "double", "Number", "",{unit}
	}}
}}
Objects:  {{
	Geometry: 1, "Geometry::mesh", "Mesh" {{
		Vertices: *{3 * len(points)} {{
			a: {numbers}
		}}
		PolygonVertexIndex: *{3 * len(faces)} {{
			a: {index}
		}}
		LayerElementMaterial: 0 {{
			Version: 101
			MappingInformationType: "AllSame"
			ReferenceInformationType: "IndexToDirect"
			Materials: *1 {{
				a: 0
			}}
		}}
		Layer: 0 {{
			Version: 100
			LayerElement:  {{
				Type: "LayerElementMaterial"
				TypedIndex: 0
			}}
		}}
	}}
	Model: 2, "Model::mesh", "Mesh" {{
		Version: 232
	}}
	Material: 3, "Material::paint", "" {{
		Version: 102
		ShadingModel: "lambert"
		Properties70:  {{
			P: "DiffuseColor", "Color", "", "A",{",".join("%.9g" % c for c in color)}
		}}
	}}
	{extra}
}}
Connections:  {{
	C: "OO",2,0
	C: "OO",1,2
	C: "OO",3,2
	{links}
}}
"""


def fbx_with_maps(points, faces, uv, maps):
    """As fbx(), white, with texture coordinates of corners; `maps`: names of properties to names of files."""
    objects = "".join(f"""
	Texture: {9 + i}, "Texture::{i}", "" {{
		Type: "TextureVideoClip"
		Version: 202
		RelativeFilename: "{file}"
		FileName: "{file}"
	}}""" for i, file in enumerate(maps.values()))
    links = "\n".join(f'C: "OP",{9 + i},3,"{name}"' for i, name in enumerate(maps))
    coordinates = f"""LayerElementUV: 0 {{
			Version: 101
			MappingInformationType: "ByPolygonVertex"
			ReferenceInformationType: "IndexToDirect"
			UV: *{2 * len(uv)} {{
				a: {",".join("%.9g" % c for t in uv for c in t)}
			}}
			UVIndex: *{3 * len(faces)} {{
				a: {",".join(str(i) for f in faces for i in f)}
			}}
		}}
		Layer: 0 {{
			LayerElement:  {{
				Type: "LayerElementUV"
				TypedIndex: 0
			}}"""
    return fbx(points, faces, (1, 1, 1), extra=objects, links=links).replace("Layer: 0 {", coordinates, 1)


def dae(points, faces, color, unit=1.0, up="Y_UP", libraries="", nodes=""):
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="paint-e"><profile_COMMON><technique sid="t"><lambert><diffuse><color>{triple(color)} 1</color></diffuse>
</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="paint" name="paint"><instance_effect url="#paint-e"/></material></library_materials>
{libraries}
<library_geometries><geometry id="mesh"><mesh>
<source id="p"><float_array id="a" count="{3 * len(points)}">{" ".join(map(triple, points))}</float_array>
<technique_common><accessor source="#a" count="{len(points)}" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(faces)}" material="m"><input semantic="VERTEX" source="#v" offset="0"/><p>{" ".join("%d %d %d" % tuple(f) for f in faces)}</p>
</triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#mesh"><bind_material><technique_common>
<instance_material symbol="m" target="#paint"/></technique_common></bind_material></instance_geometry></node>{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def dae_of_two_sets(points, first, second):
    """Two triangles of four points: base.png by the first set, glow.png by the second."""
    def source(name, rows, axes):
        return (f'<source id="{name}"><float_array id="{name}a" count="{len(rows) * len(axes)}">{" ".join("%.9g" % c for r in rows for c in r)}'
                f'</float_array><technique_common><accessor source="#{name}a" count="{len(rows)}" stride="{len(axes)}">' +
                "".join(f'<param name="{axis}" type="float"/>' for axis in axes) + "</accessor></technique_common></source>")

    def sampler(name):
        return (f'<newparam sid="{name}-s"><surface type="2D"><init_from>{name}</init_from></surface></newparam>'
                f'<newparam sid="{name}-p"><sampler2D><source>{name}-s</source></sampler2D></newparam>')
    images = "".join(f'<image id="{n}"><init_from>{n}.png</init_from></image>' for n in ("base", "glow"))
    binds = "".join(f'<bind_vertex_input semantic="CHANNEL{k}" input_semantic="TEXCOORD" input_set="{k}"/>' for k in (0, 1))
    inputs = "".join(f'<input semantic="TEXCOORD" source="#t{k}" offset="0" set="{k}"/>' for k in (0, 1))
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit name="m" meter="1"/><up_axis>Y_UP</up_axis></asset>
<library_images>{images}</library_images><library_effects><effect id="e"><profile_COMMON>{sampler("base")}{sampler("glow")}
<technique sid="t"><lambert><emission><texture texture="glow-p" texcoord="CHANNEL1"/></emission>
<diffuse><texture texture="base-p" texcoord="CHANNEL0"/></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="paint"><instance_effect url="#e"/></material></library_materials><library_geometries><geometry id="mesh"><mesh>
{source("p", points, "XYZ")}{source("t0", first, "ST")}{source("t1", second, "ST")}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="m"><input semantic="VERTEX" source="#v" offset="0"/>{inputs}<p>0 1 2 0 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#mesh"><bind_material><technique_common>
<instance_material symbol="m" target="#paint">{binds}</instance_material></technique_common></bind_material></instance_geometry></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def ds3(points, faces, color):
    def chunk(number, data):
        return struct.pack("<HI", number, 6 + len(data)) + data
    rgb = chunk(0x0010, struct.pack("<3f", *color))
    material = chunk(0xAFFF, chunk(0xA000, b"paint\0") + chunk(0xA020, rgb))
    corners = chunk(0x4110, struct.pack("<H", len(points)) + b"".join(struct.pack("<3f", *p) for p in points))
    group = chunk(0x4130, b"paint\0" + struct.pack(f"<{1 + len(faces)}H", len(faces), *range(len(faces))))
    flat = chunk(0x4150, struct.pack(f"<{len(faces)}I", *(1 << i for i in range(len(faces)))))
    triangles = chunk(0x4120, struct.pack("<H", len(faces)) + b"".join(struct.pack("<4H", *f, 0) for f in faces) + group + flat)
    return chunk(0x4D4D, chunk(0x3D3D, material + chunk(0x4000, b"mesh\0" + chunk(0x4100, corners + triangles))))


def mf3(points, faces, color):
    model = ('<?xml version="1.0"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
             '<object id="1" type="model"><mesh><vertices>' + "".join('<vertex x="%.9g" y="%.9g" z="%.9g"/>' % tuple(p) for p in points) +
             "</vertices><triangles>" + "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(f) for f in faces) +
             '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>')
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("[Content_Types].xml", '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
                         '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>')
        archive.writestr("_rels/.rels", '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
                         '<Relationship Target="/3D/3dmodel.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>')
        archive.writestr("3D/3dmodel.model", model)
    return out.getvalue()


def reals(values):
    return ",".join("%.9f" % v for v in values)


def ifc(points, faces, color):
    lines = """IFCPERSON($,$,'x',$,$,$,$,$)
IFCORGANIZATION($,'x',$,$,$)
IFCPERSONANDORGANIZATION(#1,#2,$)
IFCAPPLICATION(#2,'1','x','x')
IFCOWNERHISTORY(#3,#4,$,.ADDED.,$,$,$,0)
IFCCARTESIANPOINT((0.,0.,0.))
IFCAXIS2PLACEMENT3D(#6,$,$)
IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#7,$)
IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.)
IFCSIUNIT(*,.PLANEANGLEUNIT.,$,.RADIAN.)
IFCUNITASSIGNMENT((#9,#10))
IFCPROJECT('1',#5,'p',$,$,$,$,(#8),#11)
IFCLOCALPLACEMENT($,#7)
IFCSITE('2',#5,'s',$,$,#13,$,$,.ELEMENT.,$,$,$,$,$)
IFCBUILDING('3',#5,'b',$,$,#13,$,$,.ELEMENT.,$,$,$)
IFCRELAGGREGATES('4',#5,$,$,#12,(#14))
IFCRELAGGREGATES('5',#5,$,$,#14,(#15))
IFCBUILDINGELEMENTPROXY('6',#5,'e',$,$,#13,#24,$,$)
IFCRELCONTAINEDINSPATIALSTRUCTURE('7',#5,$,$,(#18),#15)
IFCCOLOURRGB($,%s)
IFCSURFACESTYLERENDERING(#20,0.,$,$,$,$,$,$,.FLAT.)
IFCSURFACESTYLE($,.BOTH.,(#21))
IFCPRESENTATIONSTYLEASSIGNMENT((#22))
IFCPRODUCTDEFINITIONSHAPE($,$,(#25))
IFCSHAPEREPRESENTATION(#8,'Body','Brep',(#26))
IFCFACETEDBREP(#27)
IFCCLOSEDSHELL((%s))
IFCSTYLEDITEM(#26,(#23),$)""" % (reals(color), ",".join(f"#{29 + len(points) + 3 * i + 2}" for i in range(len(faces))))
    lines = lines.split("\n")
    lines += [f"IFCCARTESIANPOINT(({reals(p)}))" for p in points]
    for i, f in enumerate(faces):
        n = 29 + len(points) + 3 * i
        lines += ["IFCPOLYLOOP((%s))" % ",".join(f"#{29 + k}" for k in f), f"IFCFACEOUTERBOUND(#{n},.T.)", f"IFCFACE((#{n + 1}))"]
    return ("ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('IFC2X3'));\n"
            "ENDSEC;\nDATA;\n" + "".join(f"#{i + 1}={line};\n" for i, line in enumerate(lines)) + "ENDSEC;\nEND-ISO-10303-21;\n")


def lwo(points, faces, color):
    def chunk(name, data, size=">I"):
        data += b"\0" * (len(data) % 2)
        return name + struct.pack(size, len(data)) + data
    def sub(name, data):
        return chunk(name, data, ">H")
    surface = b"paint\0" + b"\0\0" + sub(b"COLR", struct.pack(">3fH", *color, 0))
    surface += sub(b"DIFF", struct.pack(">fH", 1.0, 0)) + sub(b"SPEC", struct.pack(">fH", 0, 0))
    data = chunk(b"TAGS", b"paint\0") + chunk(b"LAYR", struct.pack(">2H3f", 0, 0, 0, 0, 0) + b"\0\0")
    data += chunk(b"PNTS", b"".join(struct.pack(">3f", *p) for p in points))
    data += chunk(b"POLS", b"FACE" + b"".join(struct.pack(">4H", 3, *f) for f in faces))
    data += chunk(b"PTAG", b"SURF" + b"".join(struct.pack(">2H", i, 0) for i in range(len(faces)))) + chunk(b"SURF", surface)
    return b"FORM" + struct.pack(">I", len(data) + 4) + b"LWO2" + data


def blend(points, faces, color):
    sizes = {"char": 1, "short": 2, "int": 4, "float": 4, "void": 0}
    structs = [("ListBase", "void *first,void *last"), ("ID", "char name[24]"),
               ("Base", "Base *next,Base *prev,Object *object"),
               ("Scene", "ID id,ListBase base"),
               ("Object", "ID id,int type,float obmat[4][4],void *data"),
               ("MVert", "float co[3],short no[3],char flag,char bweight"), ("MLoop", "int v,int e"), ("MPoly", "int loopstart,int totloop,short mat_nr,char flag,char pad"),
               ("Material", "ID id,float r,float g,float b,float alpha"),
               ("Mesh", "ID id,int totface,int totedge,int totvert,int totloop,int totpoly,int pad,MFace *mface,MVert *mvert,MLoop *mloop,"
                        "MPoly *mpoly,Material **mat"),
               ("MFace", "int v1,int v2,int v3,int v4")]
    types = list(sizes) + [name for name, _ in structs]
    names, layout = [], b""
    for name, fields in structs:
        fields = [f.split(" ") for f in fields.split(",")]
        size = 0
        layout += struct.pack("<2H", types.index(name), len(fields))
        for kind, field in fields:
            if field not in names:
                names.append(field)
            layout += struct.pack("<2H", types.index(kind), names.index(field))
            count = 1
            for part in field.split("[")[1:]:
                count *= int(part[:-1])
            size += 8 if field[0] == "*" else count * sizes[kind]
        sizes[name] = size

    def padded(data):
        return data + b"\0" * (-len(data) % 4)

    def texts(values):
        return struct.pack("<I", len(values)) + padded(b"".join(v.encode() + b"\0" for v in values))
    dna = b"SDNANAME" + texts(names) + b"TYPE" + texts(types) + b"TLEN" + padded(struct.pack(f"<{len(types)}H", *(sizes[t] for t in types)))
    dna += b"STRC" + struct.pack("<I", len(structs)) + layout

    def block(code, address, kind, data, count=1):
        index = [s[0] for s in structs].index(kind) if kind else 0
        return code + struct.pack("<IQ2I", len(data), address, index, count) + data

    def named(text):
        return text.encode().ljust(24, b"\0")
    one = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    mesh = named("MEmesh") + struct.pack("<6I", 0, 0, len(points), 3 * len(faces), len(faces), 0) + struct.pack("<5Q", 0, 50, 60, 70, 80)
    return (b"BLENDER-v270" + block(b"SC\0\0", 10, "Scene", named("SCscene") + struct.pack("<2Q", 20, 20)) +
            block(b"DATA", 20, "Base", struct.pack("<3Q", 0, 0, 30)) +
            block(b"OB\0\0", 30, "Object", named("OBmesh") + struct.pack("<I16fQ", 1, *one, 40)) + block(b"ME\0\0", 40, "Mesh", mesh) +
            block(b"DATA", 50, "MVert", b"".join(struct.pack("<3f8x", *p) for p in points), len(points)) +
            block(b"DATA", 60, "MLoop", b"".join(struct.pack("<2I", i, 0) for f in faces for i in f), 3 * len(faces)) +
            block(b"DATA", 70, "MPoly", b"".join(struct.pack("<2I4x", 3 * i, 3) for i in range(len(faces))), len(faces)) +
            block(b"DATA", 80, None, struct.pack("<Q", 90)) +
            block(b"MA\0\0", 90, "Material", named("MApaint") + struct.pack("<4f", *color, 1)) +
            block(b"DNA1", 100, None, dna) + block(b"ENDB", 0, None, b""))


# Of each format: its writer, whether it tells a colour (or which one assimp gives it), and its axes: y up, z up, or y up and left-handed.
FORMATS = {"off": (off, False, "y"), "ac": (ac, True, "y"), "x3d": (x3d, True, "y"), "amf": (amf, False, "y"), "dxf": (dxf, (0.9, 0.9, 0.9), "z"),
           "nff": (nff, True, "y"), "smd": (smd, (1, 1, 1), "y"), "ogex": (ogex, False, "y"), "x": (x, True, "left"), "fbx": (fbx, True, "y"),
           "dae": (dae, True, "y"), "3ds": (ds3, True, "z"), "3mf": (mf3, False, "y"),
           "ifc": (ifc, True, "z"), "lwo": (lwo, True, "left"), "blend": (blend, True, "z")}
