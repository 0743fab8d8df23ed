// Sliders that turn pictures around; dragging on the pictures does the same.
for (const box of document.querySelectorAll('.turning')) {
  const slider = box.querySelector('input');
  const strips = [...box.querySelectorAll('img')].map(img => [img, JSON.parse(img.dataset.frames)]);
  const show = () => strips.forEach(([img, frames]) => { img.src = frames[slider.value]; });
  slider.addEventListener('input', show);
  box.querySelector('.strips').addEventListener('pointermove', event => {
    const area = event.currentTarget.getBoundingClientRect();
    slider.value = Math.round((event.clientX - area.left) / area.width * slider.max);
    show();
  });
  show();
}
