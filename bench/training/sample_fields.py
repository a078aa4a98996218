"""`python -m bench.training.sample_fields`: make the fields of the sample shapes, which are part of the package.

Run it after each increase of `FIELD_VERSION`. The parameters are rounded to 16 bits, which halves the files.
"""

import numpy as np

import dfd
from dfd.app.options import SAMPLE_FACES, SAMPLE_FIELDS, SAMPLES
from dfd.field import field_file


def main() -> None:
    """Distill the field of each sample with the default settings, and write it."""
    SAMPLE_FIELDS.mkdir(exist_ok=True)
    for name in SAMPLES:
        path = SAMPLE_FIELDS / f"{name}.field.safetensors"
        field = dfd.distill(getattr(dfd.samples, name)(SAMPLE_FACES).mesh)
        field.save(path)
        architecture, arrays, settings = field_file.read(path)
        rounded = {key: array.astype(np.float16) for key, array in arrays.items() if key.startswith("network")}
        field_file.write(path, architecture, arrays | rounded, settings)
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
