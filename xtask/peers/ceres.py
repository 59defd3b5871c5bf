"""Solves a BAL problem with Ceres, through COLMAP's bundle adjuster: ceres.py FILE

All nine camera parameters free, no loss, two threads, derivatives by Ceres' own jets in C++. Prints figures as JSON.

BAL looks along -z; turned by half a turn about x it is COLMAP's camera RADIAL (f, cx, cy, k1, k2) with cx = cy = 0 held
fixed and image y negated: the same residuals, but for the sightings of points behind their camera, which are counted. The
faster of two linear solvers is stated.
"""

import json
import sys

import numpy as np
import pycolmap

THREADS = 2


def read(path):
    with open(path, encoding="ascii") as file:
        cameras, points, count = (int(word) for word in file.readline().split())
        numbers = np.array(file.read().split(), dtype=float)
    sightings = numbers[: 4 * count].reshape(count, 4)
    rest = numbers[4 * count :]
    return sightings, rest[: 9 * cameras].reshape(cameras, 9), rest[9 * cameras :].reshape(points, 3)


def build(sightings, cameras, points):
    turn = pycolmap.Rotation3d(np.array([1.0, 0.0, 0.0, 0.0]))
    scene = pycolmap.Reconstruction()
    for index, camera in enumerate(cameras):
        lens = pycolmap.Camera(
            camera_id=index + 1, model="RADIAL", width=1, height=1, params=[camera[6], 0.0, 0.0, camera[7], camera[8]]
        )
        scene.add_camera_with_trivial_rig(lens)
        seen = sightings[sightings[:, 0] == index]
        image = pycolmap.Image(
            name=str(index), keypoints=seen[:, 2:] * [1.0, -1.0], camera_id=index + 1, image_id=index + 1
        )
        rotation = turn * pycolmap.Rotation3d(camera[:3])
        pose = pycolmap.Rigid3d(rotation, camera[3:6] * [1.0, -1.0, -1.0])
        scene.add_image_with_trivial_frame(image, pose)
    order = [np.flatnonzero(sightings[:, 0] == index) for index in range(len(cameras))]
    place = np.empty(len(sightings), dtype=int)
    for rows in order:
        place[rows] = np.arange(len(rows))
    tracks = [pycolmap.Track() for _ in points]
    for row, (camera, point, _, _) in enumerate(sightings):
        tracks[int(point)].add_element(int(camera) + 1, int(place[row]))
    for point, track in zip(points, tracks):
        scene.add_point3D(point, track)
    return scene


def behind(sightings, cameras, points):
    """How many sightings have their point behind the camera: there COLMAP's residual is zero and BAL's is not."""
    count = 0
    for camera, point, _, _ in sightings:
        camera = cameras[int(camera)]
        count += (pycolmap.Rotation3d(camera[:3]) * points[int(point)])[2] + camera[5] >= 0.0
    return int(count)


def solve(scene, linear_solver):
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = True
    options.refine_principal_point = False
    options.refine_extra_params = True
    options.min_track_length = 0
    options.print_summary = False
    ceres = options.ceres
    ceres.use_gpu = False
    ceres.loss_function_type = pycolmap.LossFunctionType.TRIVIAL
    ceres.auto_select_solver_type = False
    ceres.min_num_residuals_for_cpu_multi_threading = 0
    solver = ceres.solver_options
    solver.num_threads = THREADS
    solver.linear_solver_type = linear_solver
    solver.max_num_iterations = 500
    solver.function_tolerance = 1e-9
    config = pycolmap.BundleAdjustmentConfig()
    for image in scene.images:
        config.add_image(image)
    summary = pycolmap.create_default_ceres_bundle_adjuster(options, config, scene).solve().ceres_summary
    iterations = summary.num_successful_steps + summary.num_unsuccessful_steps
    return {
        "linear_solver": linear_solver,
        "initial_cost": summary.initial_cost,
        "final_cost": summary.final_cost,
        "iterations": iterations,
        "seconds": summary.total_time_in_seconds,
        "seconds_per_iteration": summary.total_time_in_seconds / max(iterations, 1),
    }


def main():
    pycolmap.logging.minloglevel = 2
    sightings, cameras, points = read(sys.argv[1])
    runs = [solve(build(sightings, cameras, points), name) for name in ("DENSE_SCHUR", "SPARSE_SCHUR")]
    fastest = min(runs, key=lambda run: run["seconds_per_iteration"])
    version = f"Ceres {pycolmap.__ceres_version__} in pycolmap {pycolmap.__version__}"
    print(json.dumps({"version": version, "behind": behind(sightings, cameras, points), **fastest}))


main()
