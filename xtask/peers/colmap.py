"""Reconstructs a survey folder with COLMAP: colmap.py SURVEY OUT LIMIT_S

SIFT on the CPU with our masks, the intrinsics of survey.toml held fixed, two threads, both mappers. Leaves
OUT/incremental/poses.csv and OUT/global/poses.csv (the largest model, COLMAP's own frame and scale) and OUT/peer.json.
A mapper that takes longer than LIMIT_S is stopped and has placed nothing.

Tuning: up to 4,096 features with a SIFT peak threshold of 0.002 (default 0.0067), for walls with few corners; sequential
pairs up to one turn and two photos on. With all features of brick (9,800 a photo) and guided matching a pair takes seconds
on the CPU, which would only make the peer look slow: 4,096 without take 0.15 s and leave 500 verified matches.
"""

import json
import shutil
import struct
import subprocess
import sys
import time
import tomllib
import zlib
from pathlib import Path

import pycolmap

THREADS = 2


def white_png(width, height):
    """A mask that ignores nothing: COLMAP wants one for every photo or for none."""
    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = (b"\0" + b"\xff" * width) * height
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def complete_masks(survey, out, camera):
    """COLMAP's folder of masks, or None if the survey has none."""
    there = survey / "masks"
    if not there.is_dir():
        return None
    masks = out / "masks"
    masks.mkdir()
    common = there / "mask.png"
    white = white_png(camera["width_px"], camera["height_px"])
    photos = survey / "photos"
    for photo in (path for path in photos.rglob("*") if path.is_file()):
        name = photo.relative_to(photos).as_posix() + ".png"
        target = masks / name
        target.parent.mkdir(parents=True, exist_ok=True)
        source = there / name if (there / name).is_file() else common
        if source.is_file():
            shutil.copyfile(source, target)
        else:
            target.write_bytes(white)
    return masks


def reader(survey, out, config):
    """Masks and fixed intrinsics."""
    camera = config["camera"]
    if camera["model"] != "brown-conrady":
        raise SystemExit(f"camera model {camera['model']}: only brown-conrady is set up for COLMAP here")
    k1, k2, p1, p2, k3 = camera["distortion"]
    values = [camera[key] for key in ("fx_px", "fy_px", "cx_px", "cy_px")] + [k1, k2, p1, p2]
    options = pycolmap.ImageReaderOptions()
    options.camera_model = "OPENCV"
    if k3 != 0.0:
        options.camera_model = "FULL_OPENCV"
        values += [k3, 0.0, 0.0, 0.0]
    options.camera_params = ",".join(repr(float(value)) for value in values)
    masks = complete_masks(survey, out, camera)
    if masks is not None:
        options.mask_path = masks
    return options


def extract(database, survey, reading):
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = THREADS
    options.use_gpu = False
    options.sift.peak_threshold = 0.002
    options.sift.max_num_features = 4096
    pycolmap.extract_features(
        database,
        survey / "photos",
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reading,
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )


def match(database, images_per_turn):
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = THREADS
    options.use_gpu = False
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = images_per_turn + 2
    pairing.quadratic_overlap = False
    pairing.num_threads = THREADS
    pycolmap.match_sequential(
        database, matching_options=options, pairing_options=pairing, device=pycolmap.Device.cpu
    )


def map_incremental(database, survey, out):
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = THREADS
    options.random_seed = 1
    options.ba_refine_focal_length = False
    options.ba_refine_principal_point = False
    options.ba_refine_extra_params = False
    return pycolmap.incremental_mapping(database, survey / "photos", out, options)


def map_global(database, survey, out):
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = THREADS
    options.random_seed = 1
    options.mapper.num_threads = THREADS
    options.mapper.bundle_adjustment.refine_focal_length = False
    options.mapper.bundle_adjustment.refine_extra_params = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    options.mapper.global_positioning.use_gpu = False
    return pycolmap.global_mapping(database, survey / "photos", out, options)


def write_poses(path, models):
    """The largest model in our format; returns its number of photos."""
    models = list(models.values())
    lines = ["photo,qw,qx,qy,qz,x_m,y_m,z_m"]
    largest = max(models, key=lambda model: model.num_reg_images(), default=None)
    images = [] if largest is None else [largest.images[number] for number in largest.reg_image_ids()]
    for image in sorted(images, key=lambda image: image.name):
        world_from_cam = image.cam_from_world().inverse()
        qx, qy, qz, qw = world_from_cam.rotation.quat
        x, y, z = world_from_cam.translation
        numbers = (qw, qx, qy, qz, x, y, z)
        lines.append(",".join([image.name, *(f"{number:.12f}" for number in numbers)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return len(images)


MAPPERS = {"incremental": map_incremental, "global": map_global}


def map_and_write(name, database, survey, folder):
    """One mapper, in a process of its own: only so can it be stopped. That process's start is not in its time."""
    started = time.monotonic()
    models = MAPPERS[name](database, survey, folder)
    seconds = time.monotonic() - started
    print(json.dumps([write_poses(folder / "poses.csv", models), seconds]))


def mapped(name, database, survey, folder, limit_s):
    """Number of photos that a mapper has placed within its time, and that time."""
    command = [sys.executable, __file__, "--map", name, database, survey, folder]
    started = time.monotonic()
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, timeout=limit_s, check=True)
        return json.loads(done.stdout.splitlines()[-1])
    except subprocess.TimeoutExpired:
        print(f"colmap: the {name} mapper was stopped after {limit_s:.0f} s", file=sys.stderr)
    except subprocess.CalledProcessError as error:
        print(f"colmap: the {name} mapper failed: {error}", file=sys.stderr)
    return write_poses(folder / "poses.csv", {}), time.monotonic() - started


def main():
    pycolmap.logging.minloglevel = 2
    if sys.argv[1] == "--map":
        map_and_write(sys.argv[2], *map(Path, sys.argv[3:]))
        return
    survey, out, limit_s = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    config = tomllib.loads((survey / "survey.toml").read_text(encoding="utf-8"))
    database = out / "database.db"
    seconds = {}

    def told(stage, taken_s):
        seconds[stage] = taken_s
        print(f"colmap: {stage} {taken_s:.1f} s", file=sys.stderr, flush=True)

    def timed(stage, work):
        started = time.monotonic()
        work()
        told(stage, time.monotonic() - started)

    reading = reader(survey, out, config)
    timed("extract", lambda: extract(database, survey, reading))
    timed("match", lambda: match(database, config["rig"]["images_per_turn"]))
    registered = {}
    for name in MAPPERS:
        folder = out / name
        folder.mkdir()
        registered[name], taken_s = mapped(name, database, survey, folder, limit_s)
        told(name, taken_s)
    figures = {"version": pycolmap.__version__, "seconds": seconds, "registered": registered}
    (out / "peer.json").write_text(json.dumps(figures), encoding="utf-8")


main()
