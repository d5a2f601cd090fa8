"""Files for ParaView hold the floes and the fields of each frame."""

import base64
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import xarray as xr
from small_run import DOMAIN, GRIDS, small_model, small_run

from floebmi import Grid, InputError
from floebmi.paraview import export

TYPES = {"Float64": "<f8", "Int64": "<i8", "Int32": "<i4", "Int8": "<i1", "UInt8": "<u1"}


def arrays(path, block):
    """The arrays of a block of a VTK file, decoded by the rules of its format."""
    root = ElementTree.parse(path).getroot()
    assert root.get("byte_order") == "LittleEndian" and root.get("header_type") == "UInt64"
    found = {}
    for array in root.find(f".//{block}"):
        raw = base64.b64decode(array.text)
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        values = np.frombuffer(raw[8:], TYPES[array.get("type")])
        width = int(array.get("NumberOfComponents", 1))
        found[array.get("Name")] = values.reshape(-1, width) if width > 1 else values
    return found


def said(path):
    """What the elements of the mesh and of its piece say of themselves: by these words a reader makes room."""
    mesh = ElementTree.parse(path).getroot()[0]
    return mesh.attrib, mesh.find("Piece").attrib


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return small_run(tmp_path_factory.mktemp("run"))


def test_the_collection_lists_each_frame_with_its_time(run, tmp_path):
    steps = []
    collection = export(run[1], tmp_path / "vtk", progress=lambda k, n: steps.append((k, n)))
    entries = ElementTree.parse(collection).getroot().findall(".//DataSet")
    assert [float(entry.get("timestep")) for entry in entries] == [0.0, 100.0, 200.0, 300.0]
    assert all((collection.parent / entry.get("file")).exists() for entry in entries)
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert len(list(collection.parent.iterdir())) == 5


def test_floes_are_points_to_the_last_bit_without_those_that_are_not_there(run, tmp_path):
    export(run[1], tmp_path)
    with xr.open_dataset(run[1]) as data:
        for k in range(4):
            path = tmp_path / f"floes_{k:05d}.vtp"
            here = np.isfinite(data.x.values[k])
            place = arrays(path, "Points")["place"]
            assert (place[:, 0] == data.x.values[k, here]).all()
            assert (place[:, 1] == data.y.values[k, here]).all() and (place[:, 2] == 0).all()
            points = arrays(path, "PointData")
            assert (points["number"] == np.flatnonzero(here)).all()
            assert (points["radius"] == data.radius.values[here]).all()
            assert (points["velocity"][:, 0] == data.u.values[k, here]).all()
            assert (points["contact_count"] == data.contact_count.values[k, here]).all()
            verts = arrays(path, "Verts")
            assert (verts["offsets"] == np.arange(here.sum()) + 1).all()
            n = str(here.sum())
            assert said(path) == ({}, {"NumberOfPoints": n, "NumberOfVerts": n})
    assert here.sum() == 17


@pytest.mark.parametrize("kind", GRIDS)
def test_fields_are_cells_of_the_right_shape_on_each_kind_of_grid(tmp_path, kind):
    model = small_model(GRIDS[kind]())
    gridded, _, _ = small_run(tmp_path, model, frames=2)
    export(gridded, tmp_path)
    suffix = "vtr" if "rectilinear" in model.grid.kind else "vtu"
    path = tmp_path / f"fields_00001.{suffix}"
    cells = arrays(path, "CellData")
    fraction = np.where(model.grid.wet, model.fields()["area_fraction"], np.nan)
    np.testing.assert_array_equal(cells["area_fraction"], fraction)
    assert cells["ice_velocity"].shape == (model.grid.size, 3)
    if suffix == "vtr":
        corners = arrays(path, "Coordinates")
        np.testing.assert_allclose(corners["x"], model.grid.x_edges)
        np.testing.assert_allclose(corners["y"], model.grid.y_edges)
        assert list(corners) == ["x", "y", "z"]  # VTK goes by the order
        extent = "0 {1} 0 {0} 0 0".format(*model.grid.shape)
        assert said(path) == ({"WholeExtent": extent}, {"Extent": extent})
        return
    nodes, polygons = arrays(path, "Points")["nodes"], arrays(path, "Cells")
    assert (polygons["types"] == 7).all()
    sizes = {"NumberOfPoints": str(len(nodes)), "NumberOfCells": str(model.grid.size)}
    assert said(path) == ({}, sizes)
    for cell, corners in enumerate(np.split(polygons["connectivity"], polygons["offsets"][:-1])):
        x, y = nodes[corners, 0], nodes[corners, 1]
        area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
        assert area == pytest.approx(model.grid.area[cell], rel=1e-12)


@pytest.mark.parametrize("kind", GRIDS)
def test_the_wind_is_written_if_its_grid_has_the_same_cells(tmp_path, kind):
    for folder, wind, there in (
        ("same", GRIDS[kind](), kind != "unstructured"),
        ("other", Grid.uniform(DOMAIN.x, DOMAIN.y, spacing=4e3), False),
    ):
        (tmp_path / folder).mkdir()
        model = small_model(GRIDS[kind](), atmosphere_grid=wind)
        gridded, _, _ = small_run(tmp_path / folder, model, frames=1)
        export(gridded, tmp_path / folder)
        cells = arrays(next((tmp_path / folder).glob("fields_00000.*")), "CellData")
        assert ("wind" in cells) == there and "ocean_velocity" in cells
        if there:
            assert (cells["wind"] == [8.0, -4.0, 0.0]).all()  # over land, too


def test_vtk_itself_reads_the_files(run, tmp_path):
    vtk = pytest.importorskip("vtk")
    export(run[1], tmp_path)
    export(run[0], tmp_path)
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "floes_00003.vtp"))
    reader.Update()
    assert reader.GetOutput().GetNumberOfPoints() == 17
    reader = vtk.vtkXMLRectilinearGridReader()
    reader.SetFileName(str(tmp_path / "fields_00003.vtr"))
    reader.Update()
    assert reader.GetOutput().GetNumberOfCells() == 80


def test_what_cannot_be_exported_is_refused_in_one_line(run, tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        export(tmp_path / "no.nc", tmp_path / "vtk")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file; give the name of a folder"):
        export(run[1], tmp_path / "file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
