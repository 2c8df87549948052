(() => {
  'use strict';
  const root = document.documentElement;
  root.classList.add('js');

  // swipe: the range holds the value, for keyboards and screen readers; a pointer moves it directly
  for (const range of document.querySelectorAll('.swipe')) {
    const stage = range.parentElement;
    const put = (percent) => {
      range.value = Math.min(100, Math.max(0, percent));
      stage.style.setProperty('--x', range.value + '%');
    };
    const follow = (event) => {
      if (getComputedStyle(range).display === 'none') return;
      if (event.type === 'pointermove' && event.pointerType !== 'mouse' && !event.buttons) return;
      const box = stage.getBoundingClientRect();
      put(100 * (event.clientX - box.left) / box.width);
    };
    range.addEventListener('input', () => put(range.value));
    stage.addEventListener('pointerdown', follow);
    stage.addEventListener('pointermove', follow);
  }
})();
