// All videos of one episode are moved through together.
for (const box of document.querySelectorAll(".together")) {
  const videos = [...box.querySelectorAll("video")], lead = videos[0];
  const [bar, button, slider, told] = [".scrubber", "button", "input", "output"].map((name) => box.querySelector(name));
  let playing = true;
  const tell = (time) => { slider.value = time; told.textContent = `${time.toFixed(1)} s`; };
  const play = (wanted) => {
    playing = wanted;
    button.textContent = wanted ? "Pause" : "Play";
    for (const video of videos) wanted ? video.play().catch(() => {}) : video.pause();
  };
  const follow = () => {
    if (Number.isFinite(lead.duration)) slider.max = lead.duration;
    if (playing) {
      tell(lead.currentTime);
      // each is decoded at its own pace: who is a tenth of a second off is brought back
      for (const video of videos.slice(1))
        if (Math.abs(video.currentTime - lead.currentTime) > 0.1) video.currentTime = lead.currentTime;
    }
    requestAnimationFrame(follow);
  };
  button.onclick = () => play(!playing);
  slider.oninput = () => {
    const time = Number(slider.value);
    play(false);
    for (const video of videos) video.currentTime = time;
    tell(time);
  };
  bar.hidden = false;
  follow();
}
