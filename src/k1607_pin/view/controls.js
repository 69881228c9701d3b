// What both pages, offline and live, add to meshcat's viewer.
function withControls(viewer) {
  const load = viewer.set_animation.bind(viewer);
  viewer.set_animation = (animations, options) => {
    load(animations, options);
    if (animations.length) {  // show the time slider at once, not the long list of parts
      viewer.gui.open();
      viewer.gui.__folders["Scene"].close();
    }
  };

  viewer.gui.__closeButton.addEventListener("click", () => viewer.set_dirty());

  // The camera is placed so that a picture as wide as high shows everything: keep that free of the open controls.
  const render = viewer.render.bind(viewer);
  viewer.render = () => {
    const {clientWidth: width, clientHeight: height} = viewer.renderer.domElement;
    const covered = viewer.gui.closed ? 0 : Math.min(viewer.gui.domElement.offsetWidth, width / 2);
    const scale = Math.min(1, (width - covered) / height);
    const [fullWidth, fullHeight] = [width * scale, height * scale];
    viewer.camera.setViewOffset(
      fullWidth, fullHeight, (fullWidth - width + covered) / 2, (fullHeight - height) / 2, width, height);
    render();
  };
  return viewer;
}
