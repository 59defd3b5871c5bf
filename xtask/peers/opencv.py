"""Calibrates a camera with OpenCV: opencv.py PHOTOS COLUMNSxROWS, or charuco:COLUMNSxROWS:DICTIONARY (inner corners)

Corners as OpenCV's own tutorials find them (findChessboardCorners, then cornerSubPix; CharucoDetector, eight corners or more), the
five-parameter model and the fisheye model on the same corners. Prints figures as JSON; pixels with (0.5, 0.5) as the centre of the first one, as adit's.
"""

import json
import pathlib
import sys
import time

import cv2
import numpy as np

HALF_PIXEL = 0.5
LEAST_CORNERS = 8
# Of a square's side, as adit-sim draws them.
MARKER = 0.75
CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


def charuco_corners(path, detector):
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    places, numbers, _, _ = detector.detectBoard(grey)
    if numbers is None or len(numbers) < LEAST_CORNERS:
        return None, grey.shape[::-1]
    return (places.reshape(-1, 2), numbers.ravel()), grey.shape[::-1]


def corners(path, board):
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    found, places = cv2.findChessboardCorners(grey, board)
    if not found:
        return None, grey.shape[::-1]
    places = cv2.cornerSubPix(grey, places, (5, 5), (-1, -1), CRITERIA).reshape(-1, 2)
    return (places, np.arange(len(places))), grey.shape[::-1]


def figures(rms, matrix, distortion, deviations):
    return {
        "rms_px": float(rms),
        "fx_px": float(matrix[0, 0]),
        "fy_px": float(matrix[1, 1]),
        "cx_px": float(matrix[0, 2]) + HALF_PIXEL,
        "cy_px": float(matrix[1, 2]) + HALF_PIXEL,
        "distortion": [float(value) for value in np.ravel(distortion)],
        "sigma": deviations,
    }


def rms_of(errors):
    return np.sqrt(np.mean(np.sum(np.concatenate(errors) ** 2, axis=-1)))


def main():
    cv2.setNumThreads(2)
    *kind, size, name = ("charuco", *sys.argv[2].split(":")[1:]) if ":" in sys.argv[2] else (sys.argv[2], None)
    columns, rows = (int(word) for word in size.split("x"))
    if kind:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((columns + 1, rows + 1), 1.0, MARKER, dictionary))
    started = time.perf_counter()
    photos = sorted(path for path in pathlib.Path(sys.argv[1]).rglob("*") if path.suffix.lower() in (".jpg", ".jpeg"))
    every = np.zeros((columns * rows, 1, 3), np.float32)
    every[:, 0, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    seen, boards = [], []
    for path in photos:
        found, size = charuco_corners(path, detector) if kind else corners(path, (columns, rows))
        if found is not None:
            places, numbers = found
            seen.append(places.reshape(-1, 1, 2).astype(np.float32))
            boards.append(every[numbers])
    rms, matrix, distortion, _, _, deviations, _, _ = cv2.calibrateCameraExtended(boards, seen, size, None, None)
    brown = figures(rms, matrix, distortion, [float(value) for value in np.ravel(deviations)[:9]])
    matrix, distortion = np.eye(3), np.zeros((4, 1))
    _, matrix, distortion, turns, places = cv2.fisheye.calibrate(
        [board.reshape(1, -1, 3).astype(np.float64) for board in boards],
        [places.reshape(1, -1, 2).astype(np.float64) for places in seen],
        size,
        matrix,
        distortion,
        flags=cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-10),
    )
    # Its own figure is another norm in some versions; this is the one above.
    errors = [
        cv2.fisheye.projectPoints(board.reshape(1, -1, 3).astype(np.float64), turn, place, matrix, distortion)[0].reshape(-1, 2)
        - pixels.reshape(-1, 2)
        for board, turn, place, pixels in zip(boards, turns, places, seen)
    ]
    kannala = figures(rms_of(errors), matrix, distortion, None)
    seconds = time.perf_counter() - started
    print(
        json.dumps(
            {
                "version": f"OpenCV {cv2.__version__}",
                "photos": len(photos),
                "boards": len(seen),
                "corners": sum(len(places) for places in seen),
                "seconds": seconds,
                "brown-conrady": brown,
                "kannala-brandt": kannala,
            }
        )
    )


main()
