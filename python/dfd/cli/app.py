"""The command `dfd app`: edit a mesh in a browser."""

from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from dfd.cli import options
from dfd.cli.arguments import preset_of
from dfd.cli.errors import say
from dfd.common.distribution import needs
from dfd.encoders.known import DEFAULT_ENCODER


def app(
    mesh: Annotated[
        Path | None,
        Argument(
            metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file; if left out, the start page.", **options.READ
        ),
    ] = None,
    field: options.MadeField = None,
    edit: Annotated[Path | None, Option(metavar="JSON", help="Start with this edit.", **options.READ)] = None,
    sample: Annotated[str | None, Option(metavar="NAME", help="Open a sample: quadruped, chair or robot.")] = None,
    preset: options.PresetOfEdit = None,
    encoder: options.Encoder = DEFAULT_ENCODER,
    port: Annotated[
        int | None, Option(min=0, max=65535, help="The server's port; by default 8765, or a free port if 8765 is used.")
    ] = None,
    host: Annotated[
        str, Option(help="The address of the server. With the default, other machines cannot connect.")
    ] = "127.0.0.1",
    allow_host: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="A host name under which a proxy shows the app. Can be given several times."),
    ] = None,
    root_path: Annotated[
        str, Option(metavar="PATH", help="The path under which a proxy shows the app, such as /user/me/app.")
    ] = "",
    browser: Annotated[bool, Option("--browser/--no-browser", help="Open a browser.")] = True,
) -> None:
    """Edit MESH in a browser: drag a point of it, and all similar parts follow."""
    if mesh is not None and sample is not None:
        raise ValueError("`--sample` must not be given with MESH: the app opens one shape")
    if mesh is None and sample is None and (field or edit):
        raise ValueError(f"MESH must be given with `{'--field' if field else '--edit'}`")
    try:
        from dfd.app.options import OpenedFile, SessionOptions, check_sample
        from dfd.app.web.launch import serve
        from dfd.app.web.safety import check_host_name, check_root_path, loopback
    except ImportError as error:
        raise ValueError(needs("the app", "app", error)) from None
    files = (None if path is None else OpenedFile(path.name, path.resolve()) for path in (mesh, field, edit))
    opened_mesh, opened_field, opened_edit = files
    start = SessionOptions(
        mesh=opened_mesh if sample is None else check_sample(sample),
        field=opened_field,
        edit=opened_edit,
        preset=preset_of(preset, edit),
        encoder=encoder,
    )
    for option, check, values in (
        ("--allow-host", check_host_name, allow_host or []),
        ("--root-path", check_root_path, [root_path]),
    ):
        for value in values:
            try:
                check(value)
            except ValueError as error:
                raise ValueError(f"`{option}` {error}") from None
    if allow_host:
        say(
            "dfd: anybody who has the address with the token can open and change everything in the app, through the "
            f"proxy of {', '.join(allow_host)}"
        )
    if not loopback(host):
        say(
            f"dfd: with the host {host}, other machines can connect without encryption: anybody with the address can "
            "open and change everything in the app; an SSH tunnel to the default host is safer"
        )
    serve(
        start,
        host=host,
        port=port,
        browser=browser,
        tell=partial(say, result=True),
        allowed_hosts=tuple(allow_host or ()),
        root_path=root_path,
    )
