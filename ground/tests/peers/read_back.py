"""Reads one exported format with a program that is not ours and compares it with the wall as painted.

The wall (tests/support/finished.rs): a circle; red grows with the arc length s from the crown, green with x, from 20 to 220;
unseen from 30 to 45 % of s and 20 to 50 % of x. Call: read_back.py FORMAT FILE panorama.json
"""

import json
import sys
from pathlib import Path

import numpy as np


class Wall:
    """The painted wall, from its geometry alone."""

    def __init__(self, path):
        about = json.loads(Path(path).read_text())
        self.pixel = about["mm_per_px"] / 1000
        self.width, self.height = about["width_px"], about["height_px"]
        self.x0, self.perimeter = about["x0_m"], about["perimeter_m"]
        self.length = self.height * self.pixel
        self.radius = about["profile"]["radius_m"]

    def place(self, tunnel):
        """Shares of s and x at points in the tunnel frame (x forward, y right, z down)."""
        x, y, z = tunnel.T
        phi = np.arctan2(y, -z) % (2 * np.pi)
        return phi / (2 * np.pi), (x - self.x0) / self.length

    def unseen(self, s, x, margin):
        inside = lambda v, low, high: (v > low - margin) & (v < high + margin)
        return inside(s, 0.3, 0.45) & inside(x, 0.2, 0.5)

    def check(self, name, tunnel, normals, colours, tolerance):
        """Points lie on the circle, where their own colour says, normals point inwards."""
        off = np.abs(np.hypot(tunnel[:, 1], tunnel[:, 2]) - self.radius)
        assert off.max() < 0.003, f"{name}: {off.max()} m off the circle"
        s, x = self.place(tunnel)
        red, green = 20 + 200 * s, 20 + 200 * x
        inner = (s > 0.02) & (s < 0.98) & ~self.unseen(s, x, 0.03)
        assert inner.mean() > 0.4, f"{name}: {inner.mean()}"
        for channel, expected in enumerate([red, green, np.full_like(red, 60)]):
            worst = np.abs(colours[inner, channel].astype(float) - expected[inner]).max()
            assert worst <= tolerance, f"{name}: channel {channel} is off by {worst}"
        inwards = -tunnel * [0, 1, 1] / self.radius
        if normals is not None:
            assert np.abs(normals - inwards).max() < 0.02, f"{name}: normals {np.abs(normals - inwards).max()}"

    def check_cloud(self, name, tunnel, normals, colours):
        """As `check`, for all pixels that were seen, and no others."""
        self.check(name, tunnel, normals, colours, 1.5)
        s, x = self.place(tunnel)
        assert not self.unseen(s, x, -0.005).any(), f"{name}: points where nothing was seen"
        share = len(tunnel) / (self.width * self.height)
        assert abs(share - (1 - 0.15 * 0.3)) < 0.01, f"{name}: {share} of the pixels are points"
        print(f"{name}: {len(tunnel)} points")


def ply(wall, path):
    import trimesh

    cloud = trimesh.load(path)
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    normals = np.column_stack([data["nx"], data["ny"], data["nz"]])
    wall.check_cloud("ply", np.asarray(cloud.vertices), normals, np.asarray(cloud.colors)[:, :3])


def laz(wall, path):
    import laspy

    las = laspy.read(path)
    assert las.header.version == laspy.header.Version(1, 4) and las.header.point_format.id == 2
    assert list(las.header.scales) == [1e-4] * 3, las.header.scales
    assert (np.asarray(las.return_number) == 1).all() and (np.asarray(las.number_of_returns) == 1).all()
    assert np.abs(las.header.mins - las.xyz.min(axis=0)).max() < 2e-4, "bounds"
    normals = np.column_stack([las["NormalX"], las["NormalY"], las["NormalZ"]])
    colours = np.column_stack([las.red, las.green, las.blue]) / 257
    wall.check_cloud("laz", las.xyz * [1, -1, -1], normals * [1, -1, -1], colours)


def e57(wall, path):
    import pye57
    from pye57.e57 import SUPPORTED_POINT_FIELDS

    # libE57Format reads fields of registered extensions as any other; pye57 only wants to know their type.
    SUPPORTED_POINT_FIELDS.update({f"nor:normal{axis}": "f" for axis in "XYZ"})
    file = pye57.E57(str(path))
    header = file.get_header(0)
    raw = file.read_scan_raw(0)
    column = lambda *names: np.column_stack([raw[name] for name in names])
    xyz = column("cartesianX", "cartesianY", "cartesianZ")
    normals = column("nor:normalX", "nor:normalY", "nor:normalZ")
    colours = column("colorRed", "colorGreen", "colorBlue")
    assert header.point_count == len(xyz), header.point_count
    wall.check_cloud("e57", xyz * [1, -1, -1], normals * [1, -1, -1], colours)


def meshes(name, wall, path):
    """Colours looked up by texture coordinate in the middle of every triangle."""
    import trimesh

    scene = trimesh.load(path, force="scene")
    triangles, area = 0, 0.0
    for node in scene.graph.nodes_geometry:
        transform, key = scene.graph[node]
        # Of an OBJ's normals trimesh makes nothing without SciPy.
        normals = scene.geometry[key].vertex_normals if name == "glb" else None
        mesh = scene.geometry[key].copy().apply_transform(transform)
        assert key.startswith("wall_x"), key
        material = mesh.visual.material
        picture = getattr(material, "baseColorTexture", None) or material.image
        pixels = np.asarray(picture.convert("RGB"))
        assert max(pixels.shape[:2]) <= 8192
        middle = mesh.triangles_center
        # Model space is (right, up, backwards), and trimesh's v counts upwards.
        tunnel = np.column_stack([-middle[:, 2], middle[:, 0], -middle[:, 1]])
        uv = mesh.visual.uv[mesh.faces].mean(axis=1)
        column = (uv[:, 0] * pixels.shape[1]).astype(int)
        row = ((1 - uv[:, 1]) * pixels.shape[0]).astype(int)
        wall.check(f"{name} {key}", tunnel, None, pixels[row, column], 8)
        inwards = np.einsum("ij,ij->i", mesh.face_normals, -middle * [1, 1, 0])
        assert (inwards > 0).all(), f"{name}: {key} shows its back"
        if normals is not None:
            assert np.abs(normals + mesh.vertices * [1, 1, 0] / wall.radius).max() < 0.01, f"{name}: {key} normals"
        triangles, area = triangles + len(mesh.faces), area + mesh.area
    assert len(scene.geometry) > 1, "one chunk only"
    whole = wall.perimeter * wall.length
    assert 0.9 * whole < area < whole, f"{name}: {area} of {whole} m2"
    print(f"{name}: {triangles} triangles in {len(scene.geometry)} chunks, {area:.3f} m2")


def glb(wall, path):
    meshes("glb", wall, path)


def obj(wall, path):
    path = Path(path) / "model.obj"
    meshes("obj", wall, path)
    lines = [line.split() for line in path.read_text().splitlines()]
    vectors = lambda kind: np.array([[float(word) for word in words[1:]] for words in lines if words[0] == kind])
    assert np.abs(vectors("vn") + vectors("v") * [1, 1, 0] / wall.radius).max() < 0.01, "normals"


def painted(wall, width, height):
    s, x = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    return np.dstack([20 + 200 * s, 20 + 200 * x, np.full_like(s, 60)]), wall.unseen(s, x, -0.01), wall.unseen(s, x, 0.01)


def tiff(wall, path):
    import tifffile

    with tifffile.TiffFile(path) as file:
        pages = list(file.pages)
        assert [page.subfiletype for page in pages] == [0, 1, 1], [page.subfiletype for page in pages]
        for level, page in enumerate(pages):
            assert page.is_tiled and page.tile[:2] == (256, 256), page
            size = (-(-wall.height // 2**level), -(-wall.width // 2**level))
            assert page.shape[:2] == size, (page.shape, size)
            check_pixels(f"tiff level {level}", wall, page.asarray(), 2.5)
        tags = pages[0].geotiff_tags
        assert tags["ModelPixelScale"][:2] == [wall.pixel] * 2, tags
        assert tags["ModelTiepoint"][:6] == [0, 0, 0, 0, -wall.x0, 0], tags
        assert int(tags["GTRasterTypeGeoKey"]) == 1 and int(tags["ProjLinearUnitsGeoKey"]) == 9001, tags
        print(f"tiff: {[page.shape for page in pages]}, big {file.is_bigtiff}")
    gdal(wall, path)


def gdal(wall, path):
    """As GDAL (and so QGIS) sees it: axes, overviews, what is transparent."""
    import rasterio

    with rasterio.open(path) as file:
        bounds = np.array(file.bounds)
        expected = [0, -wall.x0 - wall.length, wall.perimeter, -wall.x0]
        assert np.abs(bounds - expected).max() < 1e-6, (bounds, expected)
        assert 'UNIT["metre",1' in file.crs.to_wkt(), file.crs
        assert file.overviews(1) == [2, 4], file.overviews(1)
        seen = file.dataset_mask()
        rgba = np.dstack([*file.read([1, 2, 3]), seen])
        check_pixels("gdal", wall, rgba, 8)
        print(f"gdal: {file.crs.to_wkt()}, overviews {file.overviews(1)}")


def check_pixels(name, wall, rgba, tolerance):
    colours, inside, around = painted(wall, rgba.shape[1], rgba.shape[0])
    assert (rgba[inside][:, 3] == 0).all(), f"{name}: colour where nothing was seen"
    assert (rgba[~around][:, 3] == 255).all(), f"{name}: transparent where the wall was seen"
    worst = np.abs(rgba[~around][:, :3] - colours[~around]).max()
    assert worst <= tolerance, f"{name}: off by {worst}"


def colmap(wall, folder):
    """pycolmap reads the binary model, and what it writes of it is the same, byte for byte."""
    import pycolmap

    folder = Path(folder)
    model = pycolmap.Reconstruction(folder)
    assert (model.num_images(), model.num_points3D(), model.num_cameras()) == (3, 40, 1), model.summary()
    assert model.compute_mean_reprojection_error() < 1e-3, model.compute_mean_reprojection_error()
    computed = pycolmap.Reconstruction(folder)
    computed.update_point_3d_errors()
    assert computed.compute_mean_reprojection_error() < 1e-3, computed.compute_mean_reprojection_error()
    again = folder.parent / "again"
    again.mkdir()
    model.write_binary(again)
    for name in ["cameras.bin", "points3D.bin", "images.bin"]:
        assert (folder / name).read_bytes() == (again / name).read_bytes(), f"{name} differs"
    text = pycolmap.Reconstruction(folder.parent / "colmap")
    assert text.num_points3D() == 40
    for identifier, image in model.images.items():
        other = text.image(identifier)
        assert image.name == other.name
        assert np.abs(image.cam_from_world().matrix() - other.cam_from_world().matrix()).max() < 1e-6
    print(model.summary())


if __name__ == "__main__":
    globals()[sys.argv[1]](Wall(sys.argv[3]), sys.argv[2])
