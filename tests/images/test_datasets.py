"""The benchmark layouts: found, sampled, and missing parts named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lava_vpr.datasets.layouts import DATASETS, Layout, find_layout, open_dataset
from lava_vpr.errors import InputError


def fill(folder: Path, images: int = 3, level: int = 0) -> None:
    """``images`` small images; the grey level tells the folder, unpadded numbers need the natural sort."""
    folder.mkdir(parents=True)
    for k in range(images):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((4, 4), 20 * level + k, dtype=np.uint8))


def build(root: Path, layout: Layout, images: int = 3) -> None:
    for level, relative in enumerate((*layout.references, layout.query)):
        if relative.endswith(".avi"):
            path = root / relative
            path.parent.mkdir(parents=True)
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 1.0, (32, 32))
            for _ in range(images):
                writer.write(np.zeros((32, 32, 3), dtype=np.uint8))
            writer.release()
        else:
            fill(root / relative, images, level)


EVERY_LAYOUT = [
    pytest.param(name, layout, id=f"{name}-{k}")
    for name, dataset in DATASETS.items()
    for k, layout in enumerate(dataset.layouts)
]


@pytest.mark.parametrize(("name", "layout"), EVERY_LAYOUT)
def test_every_layout_is_found(tmp_path: Path, name: str, layout: Layout) -> None:
    build(tmp_path, layout, 11)
    found, references, query = find_layout(name, tmp_path)
    assert found == layout
    assert references == tuple(tmp_path / relative for relative in layout.references)
    assert query == tmp_path / layout.query
    traverses, queries = open_dataset(name, tmp_path)
    assert len(traverses) == len(layout.references)
    for traverse in (*traverses, queries):
        assert traverse.indices.tolist() == list(range(0, 11, layout.step))


def test_the_paper_s_traverses() -> None:
    nordland = DATASETS["nordland"].layouts[0]
    assert (nordland.references, nordland.query, nordland.step) == (("spring", "fall"), "summer", 8)
    oxford = DATASETS["oxford"].layouts[0]
    assert oxford.references == ("2015-08-12-15-04-18/stereo/left", "2015-10-29-12-18-17/stereo/left")
    assert oxford.query == "2014-11-21-16-07-03/stereo/left"
    synthia = DATASETS["synthia"].layouts[0]
    assert synthia.references == ("SYNTHIA-SEQS-04-FOG/RGB/Stereo_Left/Omni_F",)
    assert synthia.query == "SYNTHIA-SEQS-04-NIGHT/RGB/Stereo_Left/Omni_F"
    lucia = DATASETS["st_lucia"].layouts[0]
    assert (lucia.references, lucia.query) == (("190809_0845/webcam_video.avi",), "180809_1545/webcam_video.avi")


def test_sampling_keeps_absolute_indices_and_the_order_of_traverses(tmp_path: Path) -> None:
    build(tmp_path, DATASETS["nordland"].layouts[0], 18)
    (spring, fall), summer = open_dataset("nordland", tmp_path)
    assert summer.names == ("0.png", "8.png", "16.png")
    assert [int(image[0, 0]) for image in spring.images()] == [0, 8, 16]
    assert [int(image[0, 0]) for image in fall.images()] == [20, 28, 36]
    assert [int(image[0, 0]) for image in summer.images()] == [40, 48, 56]
    assert len(open_dataset("nordland", tmp_path, step=1)[1]) == 18


def test_letter_case_of_folders_does_not_matter(tmp_path: Path) -> None:
    for level, name in enumerate(("Sun", "RAIN", "Dusk")):
        fill(tmp_path / name, 2, level)
    (sun, rain), dusk = open_dataset("oxford", tmp_path)
    assert [int(t.load(0)[0, 0]) for t in (sun, rain, dusk)] == [0, 20, 40]
    assert rain.source == str(tmp_path / "RAIN")


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    fill(tmp_path / "spring")
    with pytest.raises(InputError) as caught:
        open_dataset("nordland", tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}: does not hold the nordland dataset; "
        "it needs the folders spring + fall (missing) + summer (missing)"
    )
    with pytest.raises(InputError, match=r"Omni_F \(missing\), or SEQS-04-FOG.*, or ref \(missing\) \+ query \(miss"):
        open_dataset("synthia", tmp_path)
    with pytest.raises(InputError, match=r"no: is not a folder; give the folder that holds the spedtest dataset"):
        open_dataset("spedtest", tmp_path / "no")
    with pytest.raises(InputError, match=r"no dataset 'kitti'; choose from nordland, oxford, spedtest, synthia, st_l"):
        open_dataset("kitti", tmp_path)
    with pytest.raises(InputError, match=r"step is 0, but must be at least 1"):
        open_dataset("nordland", tmp_path, step=0)


def test_unequal_lengths_are_refused_only_where_images_correspond(tmp_path: Path) -> None:
    fill(tmp_path / "sped" / "ref", 3)
    fill(tmp_path / "sped" / "query", 4)
    with pytest.raises(InputError, match=r"image k must show the same place.*ref has 3, .*query has 4; complete them"):
        open_dataset("spedtest", tmp_path / "sped")
    fog, night = (tmp_path / f"SYNTHIA-SEQS-04-{n}" / "RGB" / "Stereo_Left" / "Omni_F" for n in ("FOG", "NIGHT"))
    fill(fog, 6)
    fill(night, 12)
    (reference,), query = open_dataset("synthia", tmp_path)
    assert (reference.indices.tolist(), query.indices.tolist()) == ([0, 5], [0, 5, 10])


def test_an_empty_folder_is_named(tmp_path: Path) -> None:
    fill(tmp_path / "ref")
    (tmp_path / "query").mkdir()
    with pytest.raises(InputError, match=r"query: holds no images"):
        open_dataset("spedtest", tmp_path)
