"""Makes tests/reference/magnetic_field_points.csv and tests/reference/geodesy_points.csv.

    python3 -m venv .venv && .venv/bin/pip install pygeomag==1.1.0 pyproj==3.7.2
    .venv/bin/python tools/reference/make_environment_points.py

Run from the repository root. Both sources are independent of the code under test: pygeomag reads
NOAA's own coefficient file in double precision, pyproj is the PROJ library.
"""

from importlib.metadata import version
from pathlib import Path

import pyproj
from pygeomag import GeoMag

POINTS = Path("tests/reference")
COMMAND = "python tools/reference/make_environment_points.py"

# The reference site first; then mid latitudes, both hemispheres, high latitudes, altitudes and dates.
PLACES = [
    (28.5, -80.57, 3.0, 2026.5),
    (28.5, -80.57, 3.0, 2025.0),
    (33.77, -84.4, 300.0, 2026.9),
    (48.1, 11.6, 500.0, 2027.25),
    (67.89, 21.1, 330.0, 2028.5),
    (-31.2, 136.8, 120.0, 2029.75),
    (5.2, -52.8, 0.0, 2026.0),
    (-45.0, 170.0, 1500.0, 2028.0),
    (0.0, 0.0, 0.0, 2025.5),
    (78.2, 15.6, 30.0, 2026.0),
]

# North, east, down from the pad.
OFFSETS = [
    (0.0, 0.0, 0.0),
    (0.0, 0.0, -50.0),
    (1000.0, 0.0, 0.0),
    (0.0, 1000.0, -10.0),
    (-707.0, 707.0, -100.0),
    (12.3, -45.6, 0.7),
    (-3000.0, 4000.0, -900.0),
]


def write(name, what, columns, rows):
    path = POINTS / name
    with open(path, "w", newline="\n") as out:
        out.write(f"# {what}\n# Made by: {COMMAND}\n")
        out.write(",".join(columns) + "\n")
        for row in rows:
            out.write(",".join(f"{v:.17g}" for v in row) + "\n")
    print(path, len(rows), "rows")


def magnetic_field():
    model = GeoMag(coefficients_file="wmm/WMM_2025.COF")
    rows = []
    for latitude, longitude, altitude, year in PLACES:
        field = model.calculate(glat=latitude, glon=longitude, alt=altitude / 1000.0, time=year)
        rows.append((latitude, longitude, altitude, year, field.x, field.y, field.z))
    write(
        "magnetic_field_points.csv",
        f"World Magnetic Model 2025 by pygeomag {version('pygeomag')}, file WMM_2025.COF; height on the ellipsoid.",
        ["latitude_deg", "longitude_deg", "altitude_m", "year", "north_nt", "east_nt", "down_nt"],
        rows,
    )


def geodesy():
    rows = []
    for latitude, longitude, altitude, _ in PLACES:
        # PROJ's topocentric frame is east, north, up.
        pipeline = pyproj.Transformer.from_pipeline(
            f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0={latitude} +lon_0={longitude} "
            f"+h_0={altitude} +step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
        )
        for north, east, down in OFFSETS:
            lon, lat, height = pipeline.transform(east, north, -down)
            rows.append((latitude, longitude, altitude, north, east, down, lat, lon, height))
    write(
        "geodesy_points.csv",
        f"Local NED to geodetic WGS 84 by pyproj {pyproj.__version__}, PROJ {pyproj.proj_version_str}.",
        [
            "pad_latitude_deg", "pad_longitude_deg", "pad_altitude_m", "north_m", "east_m", "down_m",
            "latitude_deg", "longitude_deg", "altitude_m",
        ],
        rows,
    )


magnetic_field()
geodesy()
