// A page that carries its documents itself: the first entry is shown once all is decoded.

unpack('overview')
  .then((overview) => {
    const page = new Page(overview);
    window.sqrp = page;
    return page.select(0).then(() => overview.placement && page.lanes());
  })
  .then(() => {
    document.documentElement.dataset.ready = 'true';
  });
