"""The page as a whole: a scene, and panels beside it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark.who import Who
from mimicbench.viewer.acting import ActPanel
from mimicbench.viewer.browsing import BrowsePanel
from mimicbench.viewer.catalog import Catalog
from mimicbench.viewer.playing import PlayPanel
from mimicbench.viewer.plotting import PlotPanel
from mimicbench.viewer.server import close_server, open_server
from mimicbench.viewer.session import Session
from mimicbench.viewer.showing import ShowPanel

if TYPE_CHECKING:
    import viser


@dataclass(frozen=True)
class ViewConfig:
    """What the page begins with."""

    workdir: Path
    port: int = 8080
    """Where it is served; the next that is free, if this one is not."""
    task: str | None = None
    """Whose items; None: the first task that has some."""
    kind: str | None = None
    """Folder of the kind of items, such as `retarget`."""
    find: str = ""
    """Words that the first item's name has."""
    failed: bool = False
    """Begin with the episodes that failed, those of `policy` first."""
    policy: tuple[str, ...] = ()
    """Folders of further checkpoints, Python and ONNX files that can be chosen to act."""


class Page:
    """A running viewer. Close it after use."""

    def __init__(self, config: ViewConfig) -> None:
        """Serve the page. Raises MimicbenchError if there is nothing to see, or what it needs is not installed."""
        catalog = Catalog(config.workdir)
        networks = [Who("", Path(os.path.abspath(path))).digests for path in config.policy] if config.failed else []
        self.server = open_server(config.port)
        _furnish(self.server)
        self.session = Session(self.server)
        self.browse = BrowsePanel(self.session, catalog)
        self.play = PlayPanel(self.session)
        self.act = ActPanel(self.session, self.play, config.workdir, config.policy)
        self.show = ShowPanel(self.session, self.act)
        self.plot = PlotPanel(self.session, self.play)
        if config.failed:
            self.browse.start_failed(config.task, config.find, networks)
        else:
            self.browse.start(config.task, config.kind, config.find)

    @property
    def url(self) -> str:
        """Where it is."""
        return f"http://localhost:{self.server.get_port()}"

    def close(self) -> None:
        """Stop serving."""
        self.play.close()
        self.show.close()
        close_server(self.server)


def _furnish(server: viser.ViserServer) -> None:
    """Floor, light and manners."""
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.gui.set_panel_label("mimicbench")
    server.scene.set_up_direction("+z")
    server.gui.main_panel.dock_right()
    server.scene.add_grid(
        "/floor",
        infinite_grid=True,
        fade_distance=18.0,
        shadow_opacity=0.25,
        cell_color=(226, 226, 230),
        section_color=(205, 205, 212),
    )
    camera = server.initial_camera
    camera.fov, camera.near = 0.75, 0.05
