"""Draws what detect/tests.rs reads: markers and ChArUco boards as OpenCV has them (opencv-contrib-python-headless 5.0.0).

codes.png: the first 100 markers of DICT_4X4_1000, DICT_5X5_1000, DICT_6X6_1000 below each other, 25 a row, in fields of 8 x 8
pixels, one pixel a cell, the black frame at the field's upper left. board-*.png: boards of 7 x 6 squares through HOMOGRAPHY.
"""

import cv2
import numpy as np

FIELD = 8
SQUARE = 160
FINER = 4
SIZE = (320, 260)
# From squares (the first one's outer corner is the origin) to pixels.
HOMOGRAPHY = np.array([[36.0, -9.0, 62.0], [10.0, 33.0, 18.0], [0.010, -0.012, 1.0]])


def codes():
    picture = np.full((3 * 4 * FIELD, 25 * FIELD), 255, np.uint8)
    for block, side in enumerate((4, 5, 6)):
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{side}X{side}_1000"))
        for marker in range(100):
            x, y = marker % 25 * FIELD, (block * 4 + marker // 25) * FIELD
            picture[y : y + side + 2, x : x + side + 2] = cv2.aruco.generateImageMarker(dictionary, marker, side + 2)
    cv2.imwrite("codes.png", picture)


def board(name, dictionary, marker):
    columns, rows = 7, 6
    dictionary = cv2.aruco.getPredefinedDictionary(dictionary)
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, marker, dictionary)
    flat = board.generateImage((columns * SQUARE, rows * SQUARE), marginSize=0)
    flat = cv2.copyMakeBorder(flat, SQUARE, SQUARE, SQUARE, SQUARE, cv2.BORDER_CONSTANT, value=255)
    squares_from_flat = np.array([[1 / SQUARE, 0, -1], [0, 1 / SQUARE, -1], [0, 0, 1]])
    fine = np.diag([FINER, FINER, 1]) @ HOMOGRAPHY @ squares_from_flat
    # OpenCV has the middle of the first pixel at 0, not at 0.5.
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    size = (SIZE[0] * FINER, SIZE[1] * FINER)
    picture = cv2.warpPerspective(flat, np.linalg.inv(half) @ fine @ half, size, flags=cv2.INTER_AREA, borderValue=120)
    picture = cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA)
    cv2.imwrite(name, cv2.GaussianBlur(40 + (picture * 0.6).astype(np.uint8), (0, 0), 0.7))


codes()
board("board-4x4.png", cv2.aruco.DICT_4X4_50, 0.75)
board("board-5x5.png", cv2.aruco.DICT_5X5_100, 0.6)
