"""The protocols of the field: names of images, pairs, tolerances and printed figures, each with its source."""

from __future__ import annotations

from lava_vpr.datasets.protocols import ANY, Names, Protocol, ProtocolLayout, Published
from lava_vpr.errors import InputError
from lava_vpr.rows.registry import Registry

PROTOCOLS: Registry[Protocol] = Registry("protocol", InputError)
"""The protocols by name."""


def _folder(folder: str, images: int, name: str = ANY, first: int = 0) -> tuple[Names, ...]:
    return (Names(folder, name, (range(first, first + images),)),)


def _github(repository: str, commit: str, file: str) -> str:
    return f"https://github.com/{repository}/blob/{commit}/{file}"


_RUNS = """
202-1259 1810-1869 2029-2187 2333-2340 2355-2483 2675-3383 3698-4092 4097-5040 5479-6043 6234-6500 6506-6755
6773-7058 7296-7758 7894-8478 8484-8488 8494-9966 9979-10041 10204-10238 10268-10407 10416-10943 10947-10984
10991-10996 11003-11007 11019-11021 11028-11029 11032-11036 11048-11056 11065-11100 11107-11128 11146-11224
11228-11279 11286-11653 11899-11914 12036-12056 12062-12073 12082-12164 12168-12203 12208-12318 12365-12408
12417-12471 12481-13344 13441-13619 13628-14319 14348-14389 14400-14806 14926-16202 16206-16471 16484-16689
16695-16932 16936-17053 17068-17176 17183-17733 17756-17867 17902-17973 17986-17990 17996-18020 18150-18160
18170-18329 18443-18539 18550-18579 18588-18660 18683-18954 18966-18976 18986-19018 19026-19091 19100-19169
19185-19715 20079-20309 20354-20539 20547-20593 20599-20736 20760-21057 21063-21477 21499-21831 21872-21946
21961-21985 22003-22013 22030-22036 22048-22148 22152-22173 22197-22211 22241-22248 22251-22262 22269-22278
22344-22357 22361-22396 22430-22441 22450-22482 22502-22570 22578-22592 22596-22786 22892-22943 22950-22998
23004-23025 23029-23044 23049-23140 23148-23165 23171-23196 23214-23401 23407-23485 23493-23495 23503-23518
23534-23570 23577-23592 23598-23665 23675-23690 23703-23706 23711-23841 23855-23949 23955-24095 24419-24987
24997-25003 25030-25036 25044-25255 25320-25372 25380-25397 25406-25506 25521-25824 25846-26085 26091-26119
26135-26391 26559-26889 26897-26996 27012-27407 27423-27431 27435-27925 27943-28686 28693-28916 28923-28951
29117-29320 29331-29383 29421-29524 29532-29692 29707-29973 29981-29993 30010-30072 30091-30102 30106-30136
30142-30173 30179-30203 30211-30412 30516-31063 31208-31300 31325-31331 31340-31395 31410-31432 31437-31447
31482-31491 31551-31610 31628-31665 31712-31747 31796-31822 31828-31830 31836-31847 31865-31902 31965-31997
32062-32101 32128-32142 32165-32213 32242-32343 32348-32366 33063-33316 33328-33340 33346-33369 33386-33429
33513-33590 33667-33716 33721-33753 33781-33916 33923-34233 34242-34630 34655-34741 34757-34774 34811-34848
34857-34977 34992-35114 35208-35361 35366-35385 35390-35394 35400-35429 35440-35463 35466-35582
"""
"""Numbers of the images a second that Patch-NetVLAD's list keeps of Nordland, without tunnels and stops: 27,592."""

_KEPT = tuple(range(int(run.split("-")[0]), int(run.split("-")[1]) + 1) for run in _RUNS.split())
_NAMES = "images-{:05d}.png"

_PATCH = _github("QVPR/Patch-NetVLAD", "39ab4e45725b1e7558dc9b108d31a7f3ce900614", "patchnetvlad/dataset_imagenames")
_BERTON = _github(
    "gmberton/VPR-datasets-downloader", "481288a5f1d7c2b704eadb12fcedf499b5df5284", "download_nordland.py"
)
_GSV_DATASETS = _github("amaralibey/gsv-cities", "77ffffc23115e5ba966e108895343693ec49cbb2", "datasets")
_VPR_BENCH = _github("MubarizZaffar/VPR-Bench", "77ad30f3684476717188c67d7f3f66be19f832af", "datasets")
_BOQ = _github("amaralibey/Bag-of-Queries", "1a4965ea7dfd9bd0dd846adf7a0e430f68101d12", "README.md")
_SALAD = _github("serizba/salad", "e5930053a63c734c2ccbe05aac0aa3ce913edf7f", "README.md")
_GSV = _github("amaralibey/gsv-cities", "77ffffc23115e5ba966e108895343693ec49cbb2", "README.md")
_LENS = _github("AdamDHines/LENS", "f44a08c843456a297c3f0ac477fa50419e215178", "lens/run_model.py")
_TUTORIAL = _github("stschubert/VPR_Tutorial", "e071309301f7b360449700371a69242ed65cad80", "{}")
_SURFDRIVE = "https://surfdrive.surf.nl/files/index.php/s/sbZRXzYe3l0v67W (VPR-Bench)"
_NORDLAND = "https://huggingface.co/datasets/Somayeh-h/Nordland"


def _boq(*figures: tuple[float, float, float]) -> tuple[Published, ...]:
    ways = (("BoQ, DINOv2", "322 x 322"), ("BoQ, ResNet50", "384 x 384"))
    return tuple(Published(name, one, _BOQ, pixels) for (name, pixels), one in zip(ways, figures, strict=True))


def _season(folder: str, numbers: tuple[range, ...] = _KEPT) -> tuple[Names, ...]:
    return (Names(folder, _NAMES, numbers),)


_TENTH = tuple(range(k, k + 1) for k in [k for some in _KEPT for k in some][::10])

PROTOCOLS.register(
    Protocol(
        "nordland-27592",
        "Nordland, summer learned, winter recognised, 10 frames",
        (
            ProtocolLayout(_season("nordland/summer"), _season("nordland/winter")),
            ProtocolLayout(_season("summer"), _season("winter")),
            ProtocolLayout(_folder("images/test/database", 27_592), _folder("images/test/queries", 27_592)),
        ),
        tolerance=10,
        page=_NORDLAND,
        sources=(_PATCH, _BERTON, "https://github.com/Tong-Jin01/EDTformer/issues/3"),
        published=_boq((90.6, 96.0, 97.5), (83.1, 91.0, 93.5)),
    )
)
PROTOCOLS.register(
    Protocol(
        "nordland-2760",
        "Nordland, winter learned, every tenth summer image recognised, 1 frame",
        (
            ProtocolLayout(_folder("ref", 27_592, "{:07d}.jpg"), _folder("query", 2_760, "{:07d}.jpg")),
            ProtocolLayout(_season("nordland/winter"), _season("nordland/summer", _TENTH)),
            ProtocolLayout(_season("winter"), _season("summer", _TENTH)),
        ),
        tolerance=1,
        every=10,
        page=_SURFDRIVE,
        sources=(
            _GSV_DATASETS + "/Nordland",
            _VPR_BENCH + "/Nordland/ground_truth_new.npy",
            "https://github.com/gmberton/VPR-datasets-downloader/issues/17",
        ),
        unsaid="That every tenth of Patch-NetVLAD's names is a query, in the second layout, is said by "
        "https://github.com/gmberton/VPR-datasets-downloader/pull/16, not by VPR-Bench.",
        published=(
            *_boq((81.3, 92.5, 94.8), (70.7, 84.0, 87.5)),
            Published("SALAD, DINOv2", (76.0, 89.2, 92.0), _SALAD, "322 x 322"),
            Published("Conv-AP, ResNet50, 8,192 values", (42.7, 58.8, None), _GSV, "320 x 320"),
        ),
    )
)


def _sections(season: str) -> tuple[Names, ...]:
    return tuple(
        Names(f"test/{season}_images_test/section{k + 1}", "{}.png", (range(1150 * k, 1150 * (k + 1)),))
        for k in range(3)
    )


PROTOCOLS.register(
    Protocol(
        "nordland-3450",
        "Nordland as parted by Olid et al., three test sections, 2 frames",
        (ProtocolLayout(_sections("summer"), _sections("winter")),),
        tolerance=2,
        page="https://webdiis.unizar.es/~jmfacil/pr-nordland/",
        sources=(
            "https://arxiv.org/abs/1808.06516",
            "https://github.com/agtbaskara/partitioned-nordland-filelist-generator",
            "https://github.com/Lu-Feng/SelaVPR/issues/6",
        ),
        unsaid="Which season is learned: here summer, as in the other splits of who printed the figure.",
        published=(
            Published(
                "SelaVPR, DINOv2",
                (85.2, 95.5, 98.5),
                _github("Lu-Feng/SelaVPR", "cf6e2062b1f2e1d251fc174a5240d786b1f0836f", "README.md"),
            ),
        ),
    )
)
PROTOCOLS.register(
    Protocol(
        "sped",
        "SPED as in VPR-Bench, cameras at two times",
        (
            ProtocolLayout(_folder("ref", 607, "{:07d}.jpg"), _folder("query", 607, "{:07d}.jpg")),
            ProtocolLayout(_folder("images/test/database", 607), _folder("images/test/queries", 607)),
        ),
        tolerance=0,
        page=_SURFDRIVE,
        sources=(_GSV_DATASETS + "/SPED", _VPR_BENCH + "/SPEDTEST/ground_truth_new.npy"),
        published=_boq((92.5, 95.9, 96.7), (86.5, 93.4, 95.7)),
    )
)
PROTOCOLS.register(
    Protocol(
        "gardens-point",
        "Gardens Point as in VPR-Bench, 2 frames",
        (ProtocolLayout(_folder("ref", 200), _folder("query", 200)),),
        tolerance=2,
        page=_SURFDRIVE,
        sources=(_VPR_BENCH + "/GardensPointWalking/ground_truth_new.npy",),
        unsaid="The names of the images; the natural order of whatever names there are counts.",
    )
)
PROTOCOLS.register(
    Protocol(
        "gardens-night",
        "Gardens Point, day learned, night recognised, on the right of the path",
        (ProtocolLayout(_folder("day_right", 200), _folder("night_right", 200)),),
        tolerance=0,
        page="https://www.tu-chemnitz.de/etit/proaut/datasets/ (GardensPoint_Walking.zip)",
        sources=(_TUTORIAL.format("datasets/load_dataset.py"),),
        unsaid="Whether its R@K leaves out images within 8 of the right one, as its curves do; here they are wrong.",
        published=(Published("HDC-DELF", (85.0, 92.5, 94.5), _TUTORIAL.format("README.md")),),
    )
)
_EVENTS_UNSAID = (
    "An option of LENS says 3 places, but its code widens the truth along both drives, so that it reaches further: 6 "
    "places where image k shows place k; and it matches two images in a row. Here: 3 places, image by image."
)
PROTOCOLS.register(
    Protocol(
        "lens",
        "LENS's example, images of events, 3 places",
        (
            ProtocolLayout(
                _folder("example-reference", 100, "image_{:04d}.png"),
                _folder("example-query", 100, "image_{:04d}.png"),
                "example-reference_example-query_GT.npy",
            ),
        ),
        tolerance=3,
        page="https://github.com/AdamDHines/LENS (lens/dataset/example/davis128)",
        sources=(_LENS,),
        unsaid=_EVENTS_UNSAID,
        learn=("--events",),
    )
)
PROTOCOLS.register(
    Protocol(
        "brisbane-event",
        "Brisbane-Event-VPR as LENS samples it, images of events, 3 places",
        (
            ProtocolLayout(
                _folder("sunset2", 641, "images_{:05d}.png"),
                _folder("sunset1", 724, "images_{:05d}.png"),
                "sunset2_sunset1_GT.npy",
            ),
        ),
        tolerance=3,
        page="https://github.com/AdamDHines/LENS (lens/dataset/brisevent/davis346); recordings: "
        "https://zenodo.org/records/4302805",
        sources=(_LENS,),
        unsaid=_EVENTS_UNSAID,
        learn=("--events",),
    )
)
