"""Packs the scenarios' robots small: their URDFs, and visual meshes of few triangles.

    pip install 'nsaid-mj[robots]'
    python scripts/pack_robots.py

Reads example-robot-data and writes assets/robots/. Only robots under a licence that permits this
are packed. Kinematics and inertias stay as they are; collision shapes and simulator tags go.
"""

import shutil
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
from example_robot_data.robots_loader import ROBOTS, getModelPath

ROBOTS_FOLDER = Path(__file__).parents[1] / "assets" / "robots"
PACKED = ("double_pendulum", "g1_legs", "go2", "kinova", "panda", "ur5", "xarm7", "z1")
TRIANGLES = 2500  # of a mesh, at most
PARTS = {"g1_legs": ("g1", ("waist", "shoulder", "elbow", "wrist"))}
"""Robots that are others with some joints fixed: the names of these contain one of the words."""
BARE = {"g1_legs"}  # packed without shapes, whose meshes no grid makes small
HULLS = {"go2"}  # drawn as their collision shapes, as visual meshes consist of too many parts


def pack(name: str, folder: Path) -> None:
    """Writes a robot's URDF and meshes into a folder of its name."""
    whole, fixed = PARTS.get(name, (name, ()))
    loader = ROBOTS[whole]
    file = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    home = Path(getModelPath(str(file)))
    own = folder / name
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True)
    root = ElementTree.parse(home / file).getroot()
    for child in [child for child in root if child.tag not in ("link", "joint", "material")]:
        root.remove(child)
    for joint in root.iter("joint"):
        if any(word in joint.attrib["name"] for word in fixed):
            joint.attrib["type"] = "fixed"
    written: dict[str, str] = {}
    dropped, drawn = ("visual", "collision") if name in HULLS else ("collision", "visual")
    for link in root.iter("link"):
        for kind in (dropped, drawn) if name in BARE else (dropped,):
            for shape in link.findall(kind):
                link.remove(shape)
        for shape in link.findall(drawn):
            shape.tag = "visual"
        for mesh in link.findall("visual/geometry/mesh"):
            (own / "meshes").mkdir(exist_ok=True)
            source = mesh.attrib["filename"]
            if source not in written:
                written[source] = f"{Path(source).stem}.stl"
                vertices, triangles = read(home, source, mesh.get("scale", "1 1 1"))
                write_stl(own / "meshes" / written[source], *simplify(vertices, triangles))
            mesh.attrib = {"filename": f"package://{name}/meshes/{written[source]}"}
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    (own / f"{name}.urdf").write_text(f"{text}\n", encoding="utf-8")


def read(home: Path, source: str, scale: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (k, 3) [m] and triangles (f, 3) of a mesh file named in a URDF."""
    path = home.parents[1] / source.removeprefix("package://")
    if not path.is_file():
        (path,) = (
            p for p in (base / path.name for base in home.rglob(path.parent.name)) if p.is_file()
        )
    factors = np.array([float(part) for part in scale.split()])
    mesh = coal.MeshLoader(coal.NODE_TYPE.BV_OBB).load(str(path), factors)
    corners = [(t[0], t[1], t[2]) for t in map(mesh.tri_indices, range(mesh.num_tris))]
    return mesh.vertices().copy(), np.array(corners)


def simplify(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merges vertices within the cells of the finest grid that leaves at most `TRIANGLES`.

    Unlike edge collapse this copes with meshes of many parts that only touch one another.
    """
    for cells in (100_000, *range(160, 8, -4)):
        found = merged(vertices, triangles, cells)
        if len(found[1]) <= TRIANGLES:
            return found
    raise SystemExit(f"no grid leaves {TRIANGLES} triangles")


def merged(vertices: np.ndarray, triangles: np.ndarray, cells: int) -> tuple:
    """The mesh with one vertex, the mean, for each cell of a grid, and no degenerate triangle."""
    size = np.ptp(vertices, axis=0).max()
    place = np.floor((vertices - vertices.min(0)) / size * cells)
    _, cell, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)
    means = np.zeros((len(count), 3))
    np.add.at(means, cell, vertices)
    corners = cell[triangles]
    distinct = np.array([len(set(each)) == 3 for each in corners.tolist()])
    turned = np.array([np.roll(each, -each.argmin()) for each in corners[distinct]])
    return means / count[:, None], np.unique(turned, axis=0)


def write_stl(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Writes a mesh as binary STL."""
    corners = vertices[triangles].astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    rows = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["n"], rows["p"] = normals, corners
    path.write_bytes(b"\0" * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes())


if __name__ == "__main__":
    for each in PACKED:
        pack(each, ROBOTS_FOLDER)
        model = pin.buildModelFromUrdf(str(ROBOTS_FOLDER / each / f"{each}.urdf"))
        megabytes = sum(f.stat().st_size for f in (ROBOTS_FOLDER / each).rglob("*")) / 1e6
        print(f"{each}: {model.nv} joints, {megabytes:.2f} MB")
