// Added to viser's page: shows a message when the viewer has ended, and folds the controls on a telephone.
(() => {
  const told = document.createElement("div");
  told.setAttribute("role", "alert");
  told.textContent = "The viewer has ended, so this page no longer changes. Start it again with: tci view";
  told.style.cssText = "display:none;position:fixed;z-index:9999;top:0;left:0;right:0;padding:10px 16px;" +
    "background:#c92a2a;color:white;font:600 15px system-ui,sans-serif;text-align:center";
  const ask = async () => {
    try {
      await fetch("/alive", { cache: "no-store" });
      told.style.display = "none";
    } catch {
      told.style.display = "block";
    }
    setTimeout(ask, 1000);
  };
  const fold = () => {
    const title = "//div[not(*) and normalize-space()='TCI']";
    const bar = document.evaluate(title, document, null, XPathResult.FIRST_ORDERED_NODE_TYPE).singleNodeValue;
    // Until it is at the bottom: a busy browser first draws another panel there, and then this one, unfolded.
    if (bar?.parentElement.nextElementSibling?.getAttribute("aria-hidden") === "false") bar.click();
    if (!(bar?.getBoundingClientRect().top > innerHeight - 100)) setTimeout(fold, 200);
  };
  // Fingers and mice on the skin of a simulated robot are touches; all others are viser's: a press is held
  // back until the server has said what lies under it.
  const touch = () => {
    const socket = new WebSocket(location.origin.replace(/^http/, "ws") + "/touch");
    const fingers = new Map(); // by pointer: null before the answer, then true on skin; and what was held back
    let opened = false;
    const client = () => Number(document.querySelector("[data-tci-client]")?.dataset.tciClient ?? -1);
    const send = (is, event) => {
      const box = fingers.get(event.pointerId).canvas.getBoundingClientRect();
      socket.send(JSON.stringify({
        is, pointer: event.pointerId, client: client(),
        x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height,
      }));
    };
    const ours = (event) => {
      event.preventDefault();
      event.stopImmediatePropagation();
    };
    const tell = { pointerdown: "down", pointermove: "move", pointerup: "up", pointercancel: "up" };
    const pointed = (event) => {
      if (!event.isTrusted) return;
      const begins = event.type === "pointerdown";
      if (begins && event.target.tagName === "CANVAS" && event.button === 0 && socket.readyState === 1 &&
          !(event.ctrlKey || event.shiftKey || event.altKey || event.metaKey))
        fingers.set(event.pointerId, { skin: null, held: [], canvas: event.target });
      const finger = fingers.get(event.pointerId);
      if (!finger) return;
      ours(event);
      if (finger.skin === null) finger.held.push(event);
      if (begins || finger.skin) send(tell[event.type], event);
      if (finger.skin && tell[event.type] === "up") fingers.delete(event.pointerId);
    };
    for (const name of Object.keys(tell)) addEventListener(name, pointed, { capture: true, passive: false });
    addEventListener("wheel", (event) => {
      const skin = [...fingers].filter(([, finger]) => finger.skin);
      if (!skin.length) return;
      ours(event);
      for (const [pointer] of skin) socket.send(JSON.stringify({ is: "wheel", pointer, y: -event.deltaY }));
    }, { capture: true, passive: false });
    const give = (finger) => {
      for (const event of finger.held) finger.canvas.dispatchEvent(new PointerEvent(event.type, event));
    };
    socket.onmessage = ({ data }) => {
      const { pointer, skin } = JSON.parse(data), finger = fingers.get(pointer);
      if (!finger) return;
      const over = finger.held.slice(1).find((event) => tell[event.type] === "up");
      finger.skin = skin;
      if (skin && over) send("up", over);
      if (!skin) give(finger);
      if (!skin || over) fingers.delete(pointer);
    };
    socket.onopen = () => (opened = true);
    socket.onclose = ({ code }) => {
      for (const finger of fingers.values()) if (finger.skin === null) give(finger);
      fingers.clear();
      if (opened && code !== 1000) setTimeout(touch, 2000); // 1000: nothing here can be touched
      for (const name of Object.keys(tell)) removeEventListener(name, pointed, { capture: true });
    };
  };
  addEventListener("load", touch);
  addEventListener("load", () => {
    document.body.append(told);
    ask();
    if (innerWidth < 576) fold(); // viser's sheet at the bottom: it would cover the robots
  });
})();
