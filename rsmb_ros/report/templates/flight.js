(() => {
  'use strict';
  // a link opens what it leads to
  const reveal = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let one = target; one; one = one.parentElement) if (one.tagName === 'DETAILS') one.open = true;
    target.scrollIntoView();
  };
  addEventListener('hashchange', reveal);
  document.addEventListener('click', (event) => {
    const link = event.target.closest('a[href^="#"]');
    if (link && link.getAttribute('href') === location.hash) reveal();
  });
  reveal();

  // timeline: what is under the pointer in words; arrow keys step, Enter follows
  const lanes = document.querySelector('.lanes');
  if (!lanes) return;
  const bins = [...lanes.querySelectorAll('.hits a')];
  const readout = document.querySelector('.readout');
  const hint = readout.textContent;
  let at = -1;
  const show = (n) => {
    if (at >= 0) bins[at].classList.remove('at');
    at = n;
    if (at >= 0) bins[at].classList.add('at');
    readout.textContent = at < 0 ? hint : bins[at].querySelector('title').textContent;
  };
  bins.forEach((bin, n) => bin.addEventListener('pointerenter', () => show(n)));
  lanes.addEventListener('pointerleave', () => show(-1));
  lanes.addEventListener('keydown', (event) => {
    const steps = { ArrowLeft: -1, ArrowRight: 1, Home: -bins.length, End: bins.length };
    if (event.key in steps) {
      show(Math.min(bins.length - 1, Math.max(0, at + steps[event.key])));
      event.preventDefault();
    } else if (event.key === 'Enter' && at >= 0) {
      location.hash = bins[at].getAttribute('href');
    }
  });
})();
