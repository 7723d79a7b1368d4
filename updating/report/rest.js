// A page that nobody touches rests: charts in 3-D ask for the next frame for ever, and get one a second then.
(() => {
  "use strict";
  const REST = 20_000, SLOW = 1000; // ms
  const request = window.requestAnimationFrame.bind(window), cancel = window.cancelAnimationFrame.bind(window);
  const resting = new Map(); // what is asked for, by numbers below 0
  let until = 0, last = 0;

  function stir() {
    until = performance.now() + REST;
    for (const [number, [wait, frame]] of resting) {
      clearTimeout(wait);
      resting.delete(number);
      request(frame);
    }
  }
  window.requestAnimationFrame = (frame) => {
    if (performance.now() < until) return request(frame);
    const number = (last -= 1);
    const wait = setTimeout(() => { resting.delete(number); frame(performance.now()); }, SLOW);
    resting.set(number, [wait, frame]);
    return number;
  };
  window.cancelAnimationFrame = (number) => {
    if (number >= 0) cancel(number);
    else if (resting.has(number)) { clearTimeout(resting.get(number)[0]); resting.delete(number); }
  };
  for (const name of ["pointermove", "pointerdown", "wheel", "keydown", "touchstart", "scroll", "resize", "message"]) {
    addEventListener(name, stir, { capture: true, passive: true });
  }
  stir();
})();
