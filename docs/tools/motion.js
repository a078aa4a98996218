// Videos play by themselves, and stop at a click; who asks for less motion starts them by hand.
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
  for (const video of document.querySelectorAll("video.gesture")) {
    video.controls = false;
    video.autoplay = true;
    video.addEventListener("click", () => (video.paused ? video.play() : video.pause()));
  }
}
